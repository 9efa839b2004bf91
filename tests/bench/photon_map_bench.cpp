// The photon map's queries, building and bytes. Run: pf_photon_map_bench.
//
// Photons lie on a floor, as dense everywhere: what the 50 nearest cost then depends on the tree alone.
// Queries come as an image asks them, neighbours one after the other, and in no order.

#include <vector>

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include "common/math/philox.h"
#include "tests/bench/floor_of_photons.h"
#include "tests/bench/thread_time.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_map.h"
#include "worker/photon/photon_map_filter.h"
#include "worker/photon/photon_tracer.h"

namespace pf {
namespace {

constexpr int kPhotons = 1000000;

const PhotonMap& floor_map() {
  static const PhotonMap map = [] {
    const Photons photons = floor_of_photons(kPhotons);
    const Photons* flows[] = {&photons};
    return PhotonMap(flows);
  }();
  return map;
}

std::vector<Vec3f> query_points(bool coherent) {
  std::vector<Vec3f> points;
  PathRng rng(2, Stream::kTest, 0, 0);
  for (int y = 0; y < 500; ++y) {
    for (int x = 0; x < 1000; ++x) {
      const Vec2f p = rng.next2();
      points.push_back(coherent
                           ? Vec3f{(static_cast<float>(x) + 0.5f) * 1e-3f, 0, (static_cast<float>(y) + 0.5f) * 2e-3f}
                           : Vec3f{p.x, 0, p.y});
    }
  }
  return points;
}

/// Estimates of irradiance from the 50 nearest photons, a second of this thread's CPU time.
void estimate_irradiance(benchmark::State& state) {
  PhotonMap map = floor_map();
  if (state.range(2) == 256) map.use_isa(PhotonTree::Isa::kAvx2);
  const std::vector<Vec3f> points = query_points(state.range(0) != 0);
  const MapFilter filter(static_cast<PhotonFilter>(state.range(1)));
  NearestPhotons found;
  Rgb sum{0, 0, 0};
  const double start = thread_seconds();
  for (auto _ : state) {
    for (const Vec3f& point : points) {
      map.nearest({point, {0, 1, 0}, 1e-2f, 50, false}, found);
      sum += filter.irradiance(map, found);
    }
  }
  benchmark::DoNotOptimize(sum);
  const double estimates = static_cast<double>(points.size()) * static_cast<double>(state.iterations());
  state.counters["Mestimates/s"] = 1e-6 * estimates / (thread_seconds() - start);
  state.counters["mean/expected"] = static_cast<double>(sum.x) / (estimates * kPhotons);
}
BENCHMARK(estimate_irradiance)
    ->ArgNames({"in_order", "filter", "bits"})
    ->Args({1, 0, 512})
    ->Args({1, 1, 512})
    ->Args({1, 2, 512})
    ->Args({0, 0, 512})
    ->Args({1, 0, 256})
    ->Unit(benchmark::kMillisecond);

void find_nearest_one(benchmark::State& state) {
  const PhotonMap& map = floor_map();
  const std::vector<Vec3f> points = query_points(state.range(0) != 0);
  std::uint64_t sum = 0;
  const double start = thread_seconds();
  for (auto _ : state) {
    for (const Vec3f& point : points) sum += map.nearest_one({point, {0, 1, 0}, 1e-2f, 1, false});
  }
  benchmark::DoNotOptimize(sum);
  state.counters["Mqueries/s"] =
      1e-6 * static_cast<double>(points.size()) * static_cast<double>(state.iterations()) / (thread_seconds() - start);
}
BENCHMARK(find_nearest_one)->ArgNames({"in_order"})->Arg(1)->Arg(0)->Unit(benchmark::kMillisecond);

/// Building, by this many threads; photons as a scene has them.
void build_map(benchmark::State& state) {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(state.range(0)));
  const auto scene = test::peer_box(16).build();
  const PhotonTracer tracer(*scene, {1, 500000, 0});
  PhotonBatch batch = tracer.trace(0);
  batch.flows[kIndirect].resize(std::min<std::size_t>(kPhotons, batch.flows[kIndirect].size()));
  const Photons* flows[] = {&batch.flows[kIndirect]};
  std::size_t bytes = 0, search_bytes = 0;
  for (auto _ : state) {
    const PhotonMap map(flows);
    bytes = map.bytes();
    search_bytes = map.search_bytes();
  }
  const double millions = 1e-6 * static_cast<double>(flows[0]->size());
  state.counters["Mphotons"] = millions;
  state.counters["MB/Mphotons"] = 1e-6 * static_cast<double>(bytes) / millions;
  state.counters["search_MB/Mphotons"] = 1e-6 * static_cast<double>(search_bytes) / millions;
  state.counters["s/Mphotons"] =
      benchmark::Counter(millions, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(build_map)->ArgNames({"threads"})->Arg(1)->Arg(2)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace pf
