#include "worker/integrators/gather_points.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include <gtest/gtest.h>

#include "common/base/parallel.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

constexpr int kWidth = 48, kHeight = 32;
constexpr int kTruthRays = 4096;

/// Irradiance at what the middles of the pixels see, by rays of their own, and interpolated between gather
/// points.
class InterpolationErrors {
 public:
  InterpolationErrors(const Scene& scene, const JobSpec& base)
      : scene_(scene),
        spec_(base),
        eye_(scene, scene.cameras().front(), kWidth, kHeight, 1),
        map_(scene, base) {
    const HemisphereGather gather(map_, base);
    const auto pixels = std::size_t{kWidth} * kHeight;
    vertices_.resize(pixels);
    truth_.resize(pixels);
    parallel_for(pixels, [&](std::size_t i) {
      const int x = static_cast<int>(i) % kWidth, y = static_cast<int>(i) / kWidth;
      const auto ray =
          eye_.camera().ray({static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f}, {0.5f, 0.5f});
      const auto hit = scene.intersect({ray.origin, ray.direction});
      if (!hit || scene.emits(*hit)) return;
      vertices_[i].emplace_back(scene, *hit, -ray.direction, eye_.media());
      PathRng rng(77, Stream::kTest, 0, static_cast<std::uint32_t>(i));
      TileFigures figures;
      truth_[i] = gather.at(vertices_[i].front(), eye_.media(), kTruthRays, rng, figures);
    });
  }

  struct Found {
    std::vector<double> errors;  ///< relative, ascending, of the pixels that are interpolated
    double points = 0;           ///< per pixel
  };
  [[nodiscard]] Found at(double error) const {
    JobSpec spec = spec_;
    spec.final_gather.error = error;
    const HemisphereGather gather(map_, spec);
    GatherPoints points(scene_, eye_, gather, spec);
    const int edge = PassOrder::edge_for(kWidth, kHeight);
    Found found;
    for (int y0 = 0; y0 < kHeight; y0 += edge) {
      for (int x0 = 0; x0 < kWidth; x0 += edge)
        points.place({x0, y0, std::min(kWidth, x0 + edge), std::min(kHeight, y0 + edge), 0});
    }
    for (int i = 0; i < kWidth * kHeight; ++i) {
      const int x = i % kWidth, y = i / kWidth;
      found.points += points.marked(x, y) ? 1.0 / (kWidth * kHeight) : 0.0;
      const auto& vertex = vertices_[static_cast<std::size_t>(i)];
      Rgb irradiance;
      if (vertex.empty() || !points.interpolate(x, y, vertex.front(), irradiance)) continue;
      const double truth = double{luminance(truth_[static_cast<std::size_t>(i)].irradiance)};
      if (truth > 0.0) found.errors.push_back(std::abs(double{luminance(irradiance)} / truth - 1.0));
    }
    std::sort(found.errors.begin(), found.errors.end());
    return found;
  }

 private:
  const Scene& scene_;
  JobSpec spec_;
  Eye eye_;
  MapGather map_;
  std::vector<std::vector<Vertex>> vertices_;  ///< by pixel; empty: nothing, or a lamp
  std::vector<GatherPoint> truth_;
};

JobSpec gather_job() {
  JobSpec spec = job(kWidth, kHeight, IntegratorType::kFinalGather, 100000);
  spec.photon_map.nearest = 60;
  spec.final_gather.rays = 1024;
  return spec;
}

TEST(GatherPoints, InterpolateWithinTheErrorThatTheJobAsksFor) {
  for (const auto& scene : {diffuse_box().build(), corner_room().build()}) {
    const InterpolationErrors errors(*scene, gather_job());
    for (const double error : {0.05, 0.1, 0.2, 0.4}) {
      const auto found = errors.at(error);
      ASSERT_GT(found.errors.size(), 100u);
      const auto quantile = [&](double part) {
        return found.errors[static_cast<std::size_t>(part * static_cast<double>(found.errors.size() - 1))];
      };
      std::printf(
          "error %.2f: %.3f points a pixel, %4zu pixels, median %.4f 90%% %.4f 95%% %.4f 99%% %.4f most "
          "%.4f\n",
          error, found.points, found.errors.size(), quantile(0.5), quantile(0.9), quantile(0.95),
          quantile(0.99), quantile(1.0));
    }
  }
}

}  // namespace
}  // namespace pf::test
