// Does it pay to compute irradiance at photons before gathering [Christensen 1999]? Run: pf_final_gather_bench.
//
// The diffuse box by final_gather with and without, on one thread: what making the maps takes (the precomputed
// estimates among it), and a gather ray. `lookups` are the rays from which on precomputing has paid for itself.

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include "common/math/sampling.h"
#include "tests/bench/thread_time.h"
#include "tests/support/scenes.h"
#include "worker/integrators/gather_rays.h"

namespace pf {
namespace {

constexpr int kRays = 400000;

struct Cost {
  double prepare = 0;  ///< s
  double ray = 0;      ///< s, tracing it included
  double brings = 0;   ///< mean of the rays: both must see the same light
};

Cost cost_of(const Scene& scene, bool precompute) {
  JobSpec spec = test::job(256, 256, IntegratorType::kFinalGather, 500000);
  spec.final_gather.precompute = precompute;
  Cost cost;
  const double start = thread_seconds();
  const MapGather gather(scene, spec);
  cost.prepare = thread_seconds() - start;
  TileFigures figures;
  // From a point of the room's middle, as the rays of one gather point go: all over the room.
  const Vec3f origin = scene.bounds().center();
  for (std::uint32_t i = 0; i < kRays; ++i) {
    PathRng rng(1, Stream::kTest, 0, i);
    const Vec3f direction = sample_sphere(rng.next2());
    cost.brings +=
        double{luminance(gather.arriving({origin, direction}, MediumStack(), rng, figures).radiance)} / kRays;
  }
  cost.ray = (thread_seconds() - start - cost.prepare) / kRays;
  return cost;
}

void precompute(benchmark::State& state) {
  const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  const auto scene = test::diffuse_box().build();
  for (auto _ : state) {
    const Cost with = cost_of(*scene, true), without = cost_of(*scene, false);
    state.counters["prepare_s"] = with.prepare;
    state.counters["prepare_s_without"] = without.prepare;
    state.counters["us/ray"] = 1e6 * with.ray;
    state.counters["us/ray_without"] = 1e6 * without.ray;
    state.counters["lookups"] = (with.prepare - without.prepare) / (without.ray - with.ray);
    state.counters["same_light"] = with.brings / without.brings;
  }
}
BENCHMARK(precompute)->Iterations(1)->Repetitions(3)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace pf
