// Photon tracing against bare Embree on the same rays, and the bytes that photons take. Run: pf_photon_bench.
//
// "Bare" replays the rays that one sub-pass of photon tracing shot, with nothing but rtcIntersect1 around them: what
// tracing with shading, roulette and storing could reach at most.

#include <benchmark/benchmark.h>

#include <tbb/global_control.h>

#include "common/math/philox.h"
#include "common/math/sampling.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/photon_tree.h"

namespace pf {
namespace {

constexpr std::uint32_t kPaths = 200000;

/// Peer box with spheres of few or of many triangles.
const Scene& scene_of(int rings) {
  static const auto small = test::peer_box(64).build();
  static const auto large = test::peer_box(224).build();  // 200k triangles a sphere
  return rings == 64 ? *small : *large;
}

/// Rays of a photon pass over diffuse surfaces, recorded by walking the stored photons' directions back and forth: from
/// every photon's position towards where it came from.
std::vector<Ray> recorded_rays(const PhotonBatch& batch) {
  std::vector<Ray> rays;
  for (const PhotonArrays& photons : batch.flows) {
    for (std::size_t i = 0; i < photons.size(); ++i) {
      const Vec3f d = unpack_direction(photons.direction[i]);
      rays.push_back({Vec3f{photons.x[i], photons.y[i], photons.z[i]} + d * 1e-4f, d});
    }
  }
  return rays;
}

void trace_photons(benchmark::State& state) {
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(state.range(1)));
  const PhotonTracer tracer(scene_of(static_cast<int>(state.range(0))), {1, kPaths, 0});
  std::uint64_t sub_pass = 0;
  std::uint64_t rays = 0;
  for (auto _ : state) {
    const PhotonBatch batch = tracer.trace(sub_pass++);
    rays += batch.rays;
    benchmark::DoNotOptimize(batch.flows[kIndirect].x.data());
  }
  state.counters["Mrays/s"] = benchmark::Counter(static_cast<double>(rays) * 1e-6, benchmark::Counter::kIsRate);
  state.counters["Mpaths/s"] =
      benchmark::Counter(static_cast<double>(sub_pass) * kPaths * 1e-6, benchmark::Counter::kIsRate);
}

void bare_rays(benchmark::State& state) {
  const Scene& scene = scene_of(static_cast<int>(state.range(0)));
  const std::vector<Ray> rays = recorded_rays(PhotonTracer(scene, {1, kPaths, 0}).trace(0));
  for (auto _ : state) {
    for (const Ray& ray : rays) benchmark::DoNotOptimize(scene.meets(ray));
  }
  state.counters["Mrays/s"] =
      benchmark::Counter(static_cast<double>(state.iterations()) * static_cast<double>(rays.size()) * 1e-6, benchmark::Counter::kIsRate);
}

BENCHMARK(bare_rays)->Arg(64)->Arg(224)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(trace_photons)->Args({64, 1})->Args({224, 1})->Args({224, 2})->UseRealTime()->Unit(benchmark::kMillisecond);

/// One million photons, one million queries of about 50 photons each.
void gather(benchmark::State& state) {
  PathRng rng(1, Stream::kTest, 0, 0);
  constexpr int kCount = 1000000;
  PhotonArrays photons;
  for (int i = 0; i < kCount; ++i) {
    const Vec2f p = rng.next2();
    photons.push({p.x, 0.0f, p.y}, {1.0f, 0.5f, 0.25f}, {0, 1, 0}, {0, 1, 0});
  }
  PhotonTree tree(std::move(photons));
  tree.use_isa(state.range(0) == 512 ? PhotonTree::Isa::kAvx512 : PhotonTree::Isa::kAvx2);
  const float radius2 = 50.0f / (kPi * kCount);
  std::uint64_t found = 0;
  for (auto _ : state) {
    // Queries as an image asks them: neighbours one after the other.
    for (int y = 0; y < 1000; ++y) {
      for (int x = 0; x < 1000; ++x) {
        const DiscQuery query{{(static_cast<float>(x) + 0.5f) * 1e-3f, 0.0f, (static_cast<float>(y) + 0.5f) * 1e-3f},
                              {0, 1, 0}, radius2, false};
        found += tree.sum_flux(query).count;
      }
    }
  }
  state.counters["photons/query"] = static_cast<double>(found) / (1e6 * static_cast<double>(state.iterations()));
}
BENCHMARK(gather)->Arg(256)->Arg(512)->Unit(benchmark::kMillisecond);

void build_tree(benchmark::State& state) {
  const PhotonTracer tracer(scene_of(64), {1, 500000, 0});
  const PhotonBatch batch = tracer.trace(0);
  for (auto _ : state) {
    const PhotonTree tree{PhotonArrays(batch.flows[kIndirect])};
    benchmark::DoNotOptimize(tree.size());
  }
  state.counters["Mphotons"] = static_cast<double>(batch.flows[kIndirect].size()) * 1e-6;
}
BENCHMARK(build_tree)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace pf
