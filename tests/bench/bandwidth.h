#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <benchmark/benchmark.h>

#include "tests/bench/thread_time.h"

namespace pf {

/// Bytes a second that one thread moves in a = b + s c over arrays far larger than caches, the triad of STREAM
/// (McCalpin 1995), the best of a few turns; three numbers move for each element, as STREAM counts.
[[nodiscard]] inline double triad_bytes_per_second() {
  constexpr std::size_t kCount = std::size_t{1} << 23;  // 64 MiB an array
  constexpr int kTurns = 4;
  static std::vector<double> a(kCount, 1.0), b(kCount, 2.0), c(kCount, 3.0);
  double best = 0;
  for (int turn = 0; turn < kTurns; ++turn) {
    const double start = thread_seconds();
    const double s = 1.0 + turn;
    for (std::size_t i = 0; i < kCount; ++i) a[i] = b[i] + s * c[i];
    benchmark::DoNotOptimize(a.data());
    benchmark::ClobberMemory();
    best = std::max(best, 3.0 * sizeof(double) * kCount / (thread_seconds() - start));
  }
  return best;
}

/// Reports the bytes that a benchmark's work moved, and their share of the triad's rate, which is measured right before
/// and right after: what else the machine does hits both. `bytes`: that the work has to touch at least, in all
/// iterations so far.
class Bandwidth {
 public:
  Bandwidth() : before_(triad_bytes_per_second()), start_(thread_seconds()) {}
  void report(benchmark::State& state, double bytes) const {
    const double rate = bytes / (thread_seconds() - start_);
    const double triad = std::max(before_, triad_bytes_per_second());
    state.counters["GB/s"] = 1e-9 * rate;
    state.counters["of_triad"] = rate / triad;
    state.counters["triad_GB/s"] = 1e-9 * triad;
  }

 private:
  double before_;
  double start_;
};

}  // namespace pf
