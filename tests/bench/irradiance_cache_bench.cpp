// Gather rays that irradiance caching saves, at what error. Run: pf_irradiance_cache_bench.
//
// A room with a block (tests/support) at 256 x 256: the error of the indirect layer against gathering at
// every pixel with the same source, 4,096 rays and no interpolation, which is what the cache stands for.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "common/base/parallel.h"
#include "tests/support/scenes.h"
#include "worker/integrators/gather_path.h"
#include "worker/integrators/irradiance_cache.h"

namespace pf {
namespace {

constexpr int kEdge = 256;
constexpr int kStep = 2;  ///< every second pixel is looked at

struct Pixel {
  Vertex vertex;
  MediumStack media;
};

/// What the middle of the looked-at pixels sees.
std::vector<Pixel> pixels_of(const Scene& scene) {
  const Eye eye(scene, scene.cameras().front(), kEdge, kEdge, 1);
  std::vector<Pixel> pixels;
  for (int y = 0; y < kEdge; y += kStep) {
    for (int x = 0; x < kEdge; x += kStep) {
      const Eye::Start start = eye.start(x, y, 7);
      const auto hit = scene.intersect(start.ray);
      if (!hit || scene.emits(*hit)) continue;
      pixels.push_back({Vertex(scene, *hit, -start.ray.direction, eye.media()), eye.media()});
    }
  }
  return pixels;
}

/// Irradiance of every pixel by rays of its own.
std::vector<double> gathered(const Scene& scene, const std::vector<Pixel>& pixels, int rays,
                             std::uint64_t first_stream) {
  const PathGather source(scene, 32);
  const IrradianceBuilder builder(scene, source, JobSpec::IrradianceCache{}, 99);
  std::vector<double> values(pixels.size());
  parallel_for(pixels.size(), [&](std::size_t i) {
    TileFigures figures;
    const GatherPlace place(pixels[i].vertex, pixels[i].media, 0.0f);
    const auto samples = builder.gather(place, HemisphereGrid::of_rays(rays), first_stream + i, figures);
    values[i] = double{luminance(estimate_irradiance(samples, Frame::from_normal(place.normal)).irradiance)};
  });
  return values;
}

/// Root of the mean squared relative error without the worst thousandth: there, in the gap behind the lamp,
/// it is nearly black.
double relative_error(const std::vector<double>& values, const std::vector<double>& truth) {
  std::vector<double> squares(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double e = (values[i] - truth[i]) / (truth[i] + 0.01);
    squares[i] = e * e;
  }
  std::sort(squares.begin(), squares.end());
  squares.resize(squares.size() - squares.size() / 1000);
  return std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.0) / static_cast<double>(squares.size()));
}

struct Truth {
  std::unique_ptr<const Scene> scene = test::diffuse_box().build();
  std::vector<Pixel> pixels = pixels_of(*scene);
  std::vector<double> irradiance = gathered(*scene, pixels, 4096, 1u << 20);
};
const Truth& truth() {
  static const Truth made;
  return made;
}

/// Arguments: error in percent, rays of a record.
void cached(benchmark::State& state) {
  const Truth& t = truth();
  JobSpec spec = test::job(kEdge, kEdge, IntegratorType::kIrradianceCache);
  spec.irradiance_cache.source = GatherSource::kPath;
  spec.irradiance_cache.error = static_cast<double>(state.range(0)) / 100.0;
  spec.irradiance_cache.rays = static_cast<int>(state.range(1));
  spec.photon_map.caustic_photons = 1000;
  for (auto _ : state) {
    const IrradianceCacheIntegrator integrator(*t.scene, t.scene->cameras().front(), spec);
    std::vector<double> values;
    std::vector<double> found;
    for (std::size_t i = 0; i < t.pixels.size(); ++i) {
      const auto read = integrator.cache().interpolate(t.pixels[i].vertex.point.position, t.pixels[i].vertex.bsdf.ns());
      if (!read) continue;
      values.push_back(double{luminance(*read)});
      found.push_back(t.irradiance[i]);
    }
    state.counters["records"] = static_cast<double>(integrator.figures().records);
    state.counters["rays/pixel"] = static_cast<double>(integrator.figures().gather_rays) / (kEdge * kEdge);
    state.counters["error"] = relative_error(values, found);
    state.counters["missed"] = 1.0 - static_cast<double>(values.size()) / static_cast<double>(t.pixels.size());
  }
}
BENCHMARK(cached)
    ->Args({30, 512})
    ->Args({15, 256})
    ->Args({15, 512})
    ->Args({15, 1024})
    ->Args({10, 512})
    ->Args({15, 2048})
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);

/// Gathering at every pixel, by so many rays.
void at_every_pixel(benchmark::State& state) {
  const Truth& t = truth();
  for (auto _ : state) {
    const auto values = gathered(*t.scene, t.pixels, static_cast<int>(state.range(0)), 0);
    state.counters["rays/pixel"] =
        static_cast<double>(HemisphereGrid::of_rays(static_cast<int>(state.range(0))).cells());
    state.counters["error"] = relative_error(values, t.irradiance);
  }
}
BENCHMARK(at_every_pixel)->Arg(128)->Arg(512)->Arg(1024)->Iterations(1)->Unit(benchmark::kMillisecond);

/// One lookup in the cache of the room.
void interpolate(benchmark::State& state) {
  const Truth& t = truth();
  JobSpec spec = test::job(kEdge, kEdge, IntegratorType::kIrradianceCache);
  spec.irradiance_cache.source = GatherSource::kPath;
  spec.irradiance_cache.rays = 64;
  spec.photon_map.caustic_photons = 1000;
  const IrradianceCacheIntegrator integrator(*t.scene, t.scene->cameras().front(), spec);
  std::size_t i = 0;
  for (auto _ : state) {
    const Vertex& vertex = t.pixels[i++ % t.pixels.size()].vertex;
    benchmark::DoNotOptimize(integrator.cache().interpolate(vertex.point.position, vertex.bsdf.ns()));
  }
}
BENCHMARK(interpolate);

}  // namespace
}  // namespace pf
