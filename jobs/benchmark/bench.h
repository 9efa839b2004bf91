#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "jobs/benchmark/analysis.h"
#include "jobs/benchmark/runner.h"

namespace pf::bench {

struct BenchRequest {
  std::filesystem::path suite;
  std::filesystem::path out;
  std::filesystem::path cache;  ///< of references; empty: `out`/references
  std::string worker;           ///< SHA-256 of the renderer
  bool retry_failed = false;    ///< runs that failed before are made again
  bool report_only = false;     ///< from what is there: nothing is rendered
};

/// Where a bench is. `left`: seconds, from the time that runs took so far; below zero: not known.
struct BenchProgress {
  std::size_t done = 0, total = 0;  ///< runs
  std::string doing;
  double left = -1;
};

/// Makes what is missing of a suite's references and runs, and measures all of it. Finished runs are kept in `out` and
/// never made again while suite, scene files and renderer stay the same; a kill at any moment costs the run that it
/// hits. A run that fails is a result like any other. `notes`: what the reader of the report should know. Errors:
/// kUsage (`out` is in use or cannot be written), kInvalidSpec, kInterrupted, kUnavailable, kInternal.
[[nodiscard]] Result<BenchResult> run_bench(const BenchRequest& request, Runner& runner,
                                            const std::function<void(const BenchProgress&)>& progress,
                                            std::vector<std::string>& notes);

}  // namespace pf::bench
