// Photon tracing against bare Embree on the same rays, and the bytes that photons take. Run: pf_photon_bench.
//
// "Bare" replays every ray that a sub-pass of photon tracing shot, in the same order, with nothing but
// rtcIntersect1: what tracing with shading, roulette and storing could reach at most. Both take turns in one
// process, by the thread's CPU time.

#include <algorithm>
#include <vector>

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include "common/base/memory.h"
#include "common/math/sampling.h"
#include "tests/bench/floor_of_photons.h"
#include "tests/bench/thread_time.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/photon_tree.h"

namespace pf {
namespace {

constexpr std::uint32_t kPaths = 65536;

/// Peer box with spheres of few or of many triangles.
const Scene& scene_of(int rings) {
  static const auto small = test::peer_box(16).build();
  static const auto large = test::peer_box(224).build();  // 200k triangles a sphere
  return rings == 16 ? *small : *large;
}

template <typename Work>
double seconds_of(Work&& work) {
  const double start = thread_seconds();
  work();
  return thread_seconds() - start;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Traces a sub-pass on one thread and replays its rays, taking turns which comes first.
void trace_against_bare_rays(benchmark::State& state) {
  keep_freed_memory();  // as the worker does
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Scene& scene = scene_of(static_cast<int>(state.range(0)));
  const PhotonTracer tracer(scene, {1, kPaths, 0});
  std::vector<double> bare;
  std::vector<double> traced;
  std::vector<double> ratio;
  std::uint64_t sub_pass = 0;
  for (auto _ : state) {
    const std::vector<Ray> rays = tracer.rays_of(sub_pass);
    const auto trace = [&] {
      const PhotonBatch batch = tracer.trace(sub_pass);
      benchmark::DoNotOptimize(batch.flows[kIndirect].data());
    };
    const auto replay = [&] {
      for (const Ray& ray : rays) benchmark::DoNotOptimize(scene.meets(ray));
    };
    const bool trace_first = sub_pass++ % 2 == 0;
    const double first = trace_first ? seconds_of(trace) : seconds_of(replay);
    const double second = trace_first ? seconds_of(replay) : seconds_of(trace);
    const auto million_rays = static_cast<double>(rays.size()) * 1e-6;
    traced.push_back(million_rays / (trace_first ? first : second));
    bare.push_back(million_rays / (trace_first ? second : first));
    ratio.push_back(traced.back() / bare.back());
    state.SetIterationTime(first + second);
  }
  state.counters["Mrays/s bare"] = median(bare);
  state.counters["Mrays/s traced"] = median(traced);
  state.counters["ratio"] = median(ratio);
}
BENCHMARK(trace_against_bare_rays)->Arg(16)->Arg(224)->UseManualTime()->Unit(benchmark::kMillisecond);

/// One million photons, 1,016,064 queries of about 50 photons each, by a cursor or by the tree alone.
void gather(benchmark::State& state) {
  constexpr int kCount = 1000000;
  constexpr int kTileEdge = 16;
  constexpr int kTiles = 63;  // of 16 x 16 queries
  constexpr float kStep = 1.0f / (kTiles * kTileEdge);
  PhotonTree tree(floor_of_photons(kCount));
  tree.use_isa(state.range(0) == 512 ? PhotonTree::Isa::kAvx512 : PhotonTree::Isa::kAvx2);
  const float radius2 = 50.0f / (kPi * kCount);
  const bool with_cursor = state.range(1) != 0;
  std::uint64_t found = 0;
  for (auto _ : state) {
    // Queries as an image asks them: tile by tile, there and back again.
    for (int tile = 0; tile < kTiles * kTiles; ++tile) {
      GatherCursor cursor(tree);
      for (int i = 0; i < kTileEdge * kTileEdge; ++i) {
        const int row = i / kTileEdge, column = row % 2 == 0 ? i % kTileEdge : kTileEdge - 1 - i % kTileEdge;
        const int x = tile % kTiles * kTileEdge + column, y = tile / kTiles * kTileEdge + row;
        const DiscQuery query{{(static_cast<float>(x) + 0.5f) * kStep, 0.0f, (static_cast<float>(y) + 0.5f) * kStep},
                              {0, 1, 0},
                              radius2,
                              false};
        found += (with_cursor ? cursor.sum_flux(query) : tree.sum_flux(query)).count;
      }
    }
  }
  state.counters["photons/query"] =
      static_cast<double>(found) / (kTiles * kTiles * kTileEdge * kTileEdge * static_cast<double>(state.iterations()));
}
BENCHMARK(gather)->ArgsProduct({{256, 512}, {0, 1}})->ArgNames({"isa", "cursor"})->Unit(benchmark::kMillisecond);

void build_tree(benchmark::State& state) {
  const PhotonTracer tracer(scene_of(16), {1, 500000, 0});
  const PhotonBatch batch = tracer.trace(0);
  for (auto _ : state) {
    const PhotonTree tree{Photons(batch.flows[kIndirect])};
    benchmark::DoNotOptimize(tree.size());
  }
  state.counters["Mphotons"] = static_cast<double>(batch.flows[kIndirect].size()) * 1e-6;
}
BENCHMARK(build_tree)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace pf
