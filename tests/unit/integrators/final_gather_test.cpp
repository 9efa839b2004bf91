#include "worker/integrators/final_gather.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

JobSpec gather_job(int width, int height, double error) {
  JobSpec spec = job(width, height, IntegratorType::kFinalGather, 30000);
  spec.photon_map.caustic_photons = 10000;
  spec.photon_map.nearest = 60;
  spec.final_gather.rays = 64;
  spec.final_gather.error = error;
  return spec;
}

/// Marks per pixel and rays of a picture of one sample a pixel.
std::pair<std::vector<std::int64_t>, std::uint64_t> marks_of(const Scene& scene, const JobSpec& spec,
                                                             std::uint64_t passes = 1) {
  const Film film = render(scene, spec, passes);
  std::vector<std::int64_t> marks;
  for (const ExtraSums& extra : film.sums().extras) marks.push_back(extra.marks);
  return {marks, film.sums().rays};
}

std::int64_t marks_within(const std::vector<std::int64_t>& marks, int width, int x0, int y0, int x1, int y1) {
  std::int64_t sum = 0;
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) sum += marks[static_cast<std::size_t>(y * width + x)];
  }
  return sum;
}

TEST(GatherPoints, LieSparselyOnFlatWallsAndDenselyInCorners) {
  const auto scene = corner_room().build();
  const auto [marks, rays] = marks_of(*scene, gather_job(128, 64, 0.15));
  const auto flat = marks_within(marks, 128, 0, 0, 32, 64) + marks_within(marks, 128, 96, 0, 128, 64);
  const auto corner = marks_within(marks, 128, 48, 0, 80, 64);
  EXPECT_GT(flat, 0);
  EXPECT_GT(static_cast<double>(corner) / 32, 3.0 * static_cast<double>(flat) / 64) << corner << ' ' << flat;
  EXPECT_LT(flat, 64 * 64 / 8);
}

TEST(GatherPoints, GrowInNumberAsTheErrorBoundFalls) {
  const auto scene = corner_room().build();
  std::int64_t last = 0;
  for (const double error : {0.4, 0.2, 0.1}) {
    const auto [marks, rays] = marks_of(*scene, gather_job(64, 32, error));
    const std::int64_t count = marks_within(marks, 64, 0, 0, 64, 32);
    EXPECT_GT(count, last) << error;
    last = count;
  }
}

TEST(GatherPoints, LieOnNoFinerLatticeThanTwoPixels) {
  const auto scene = corner_room().build();
  const auto [marks, rays] = marks_of(*scene, gather_job(32, 16, 1e-6));
  std::int64_t on_lattice = 0;
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 32; ++x) {
      const std::int64_t mark = marks_within(marks, 32, x, y, x + 1, y + 1);
      const bool lattice = x % GatherPoints::kFinest == 0 && y % GatherPoints::kFinest == 0;
      if (lattice) on_lattice += mark;
      EXPECT_TRUE(lattice || mark == 0) << x << ' ' << y;
    }
  }
  EXPECT_GT(on_lattice, 32 * 16 / 8);
}

TEST(FinalGather, InterpolationSavesRaysAtNoGreaterError) {
  const auto scene = diffuse_box().build();
  JobSpec spec = gather_job(80, 80, 0.0);
  constexpr std::uint64_t kPasses = 8;
  // The same photons throughout: what differs is the gathering.
  spec.final_gather.rays = 128;
  const std::vector<Rgb> reference = layer_of(render(*scene, spec, kPasses), "indirect");
  struct Gathered {
    double error;        ///< relMSE of the indirect light
    std::uint64_t rays;  ///< eye rays, and those that trace photons and precompute irradiance, included
  };
  const auto gathered = [&](int rays, double error) {
    spec.final_gather.rays = rays;
    spec.final_gather.error = error;
    const Film film = render(*scene, spec, kPasses);
    const std::vector<Rgb> image = layer_of(film, "indirect");
    double sum = 0.0;
    for (std::size_t i = 0; i < image.size(); ++i) {
      const double d = static_cast<double>(luminance(image[i] - reference[i])),
                   r = static_cast<double>(luminance(reference[i]));
      sum += d * d / (r * r + 0.01);
    }
    return Gathered{sum / static_cast<double>(image.size()), film.sums().rays};
  };
  const Gathered one = gathered(1, 0.0), every_sample = gathered(24, 0.0), interpolated = gathered(128, 0.3);
  const std::uint64_t others = one.rays - kPasses * 80 * 80;
  EXPECT_LT(interpolated.error, every_sample.error);
  EXPECT_LT(2 * (interpolated.rays - others), every_sample.rays - others);
}

TEST(FinalGather, InterpolationErrsLessThanItsBoundAllows) {
  const auto scene = corner_room().build();
  JobSpec spec = gather_job(48, 24, 0.0);
  spec.final_gather.rays = 1024;
  // The same photons throughout: what differs is the interpolation, and the noise of so many rays.
  const std::vector<Rgb> reference = layer_of(render(*scene, spec, 4), "indirect");
  for (const double error : {0.05, 0.4}) {
    spec.final_gather.error = error;
    const std::vector<Rgb> image = layer_of(render(*scene, spec, 4), "indirect");
    std::vector<double> off;
    for (std::size_t i = 0; i < image.size(); ++i) {
      const double r = double{luminance(reference[i])};
      off.push_back(std::abs(double{luminance(image[i])} - r) / r);
    }
    std::ranges::sort(off);
    EXPECT_LT(off[off.size() * 99 / 100], error);
    EXPECT_LT(off[off.size() / 2], 0.3 * error);
  }
}

TEST(FinalGather, GivesTheSameBitsOnAnyNumberOfThreadsAndInAnyOrderOfTiles) {
  const auto scene = peer_box(16).build();
  for (const double error : {0.0, 0.2}) {
    JobSpec spec = gather_job(40, 24, error);
    spec.final_gather.rays = 24;
    std::vector<PixelSums> first;
    std::vector<ExtraSums> first_extras;
    for (const int threads : {1, 2, 5}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
      tbb::task_arena arena(threads);
      arena.execute([&] {
        const auto integrator = make_integrator(*scene, spec);
        const FilmOptions options = integrator->film_options();
        Statistics sums(options.width, options.height, true, true);
        const std::uint64_t units = PassOrder(options).sub_passes(2);
        // Backwards with five threads.
        for (std::uint64_t u = 0; u < units; ++u) integrator->run({threads == 5 ? units - 1 - u : u, 1}, {}, sums);
        EXPECT_EQ(sums.faults.not_finite + sums.faults.overflow, 0u);
        if (first.empty()) {
          first = sums.pixels;
          first_extras = sums.extras;
        }
        EXPECT_TRUE(first == sums.pixels) << threads;
        EXPECT_TRUE(first_extras == sums.extras) << threads;
      });
    }
  }
}

TEST(MapMethods, CountThePhotonsOfTheirMapsOnce) {
  const auto scene = peer_box(16).build();
  JobSpec spec = gather_job(24, 16, 0.2);
  spec.final_gather.rays = spec.irradiance_cache.rays = 8;
  for (const auto type : {IntegratorType::kPhotonMap, IntegratorType::kFinalGather, IntegratorType::kIrradianceCache}) {
    spec.integrator.type = type;
    const Film film = render(*scene, spec, 2);
    EXPECT_EQ(film.sums().photon_paths, 30000u + 10000u) << to_string(type);
    EXPECT_GT(film.sums().photons_stored, 30000u) << to_string(type);
  }
}

TEST(PhotonMapIntegrator, GivesTheSameBitsOnAnyNumberOfThreads) {
  const auto scene = peer_box(16).build();
  JobSpec spec = gather_job(40, 24, 0.0);
  spec.integrator.type = IntegratorType::kPhotonMap;
  std::vector<PixelSums> first;
  for (const int threads : {1, 2, 5}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    arena.execute([&] {
      const Film film = render(*scene, spec, 2);
      if (first.empty()) first = film.sums().pixels;
      EXPECT_TRUE(first == film.sums().pixels) << threads;
    });
  }
}

}  // namespace
}  // namespace pf::test
