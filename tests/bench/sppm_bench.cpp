// What choosing the first radii costs against one sub-pass of the same image. Run: pf_sppm_bench.

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include "tests/bench/thread_time.h"
#include "tests/support/scenes.h"
#include "worker/integrators/sppm.h"

namespace pf {
namespace {

/// On one thread, by its CPU time.
void initial_radii_against_sub_pass(benchmark::State& state) {
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  static const auto scene = test::peer_box(64).build();
  const auto height = static_cast<int>(state.range(0));
  const SppmIntegrator integrator(*scene, scene->cameras()[0],
                                  test::job(height, height, IntegratorType::kSppm, 500000));
  double radii = 0.0;
  double sub_pass = 0.0;
  std::uint64_t pass = 0;
  for (auto _ : state) {
    const double start = thread_seconds();
    const auto pixels = integrator.initial_radii();
    const double middle = thread_seconds();
    Statistics sums(height, height);
    integrator.run({pass++, 1}, pixels, sums);
    radii += middle - start;
    sub_pass += thread_seconds() - middle;
    state.SetIterationTime(thread_seconds() - start);
  }
  const auto runs = static_cast<double>(state.iterations());
  state.counters["s radii"] = radii / runs;
  state.counters["s sub-pass"] = sub_pass / runs;
  state.counters["ratio"] = radii / sub_pass;
}
BENCHMARK(initial_radii_against_sub_pass)
    ->Arg(256)
    ->Arg(1024)
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace pf
