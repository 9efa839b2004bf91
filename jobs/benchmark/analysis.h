#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/base/result.h"
#include "common/film/figures.h"
#include "jobs/benchmark/ablation.h"
#include "jobs/benchmark/reference.h"
#include "jobs/benchmark/schedule.h"
#include "jobs/benchmark/statistics.h"
#include "jobs/benchmark/suite.h"

namespace pf::bench {

/// One image of one run: what it cost and how far it is from the reference. Figures that do not exist are NaN.
struct Sample : SnapshotFigures {
  double rel_mse = 0, rel_mse_trimmed = 0, rmse = 0, hdr_flip = 0, mean_ratio = 0;
  double rel_mse_corrected = 0;     ///< rel_mse less the reference's own noise; may be below zero
  bool at_reference_noise = false;  ///< the corrected error is no more than the reference's noise
  std::uint64_t nonfinite_pixels = 0, negative_pixels = 0;
  std::filesystem::path exr;
};

/// What came of one run.
struct RunResult {
  const Run* run = nullptr;
  std::string error;  ///< empty: it went well
  double load_seconds = 0, prepare_seconds = 0, wall_seconds = 0;
  double load_average = 0;  ///< of the machine, when it ended
  std::vector<std::string> warnings;
  std::vector<Sample> samples;  ///< ascending budgets
};

/// All runs of a method on a scene with one budget.
struct Group {
  double budget = 0, seconds = 0, cpu_seconds = 0, photon_paths = 0, rays = 0, peak_bytes = 0;  ///< means
  double rel_mse = 0, rel_mse_corrected = 0, rel_mse_low = 0, rel_mse_high = 0, rel_mse_trimmed = 0, rmse = 0,
         hdr_flip = 0;
  double passes = 0;
  bool at_reference_noise = false;
  int runs = 0;
  std::optional<ErrorParts> relative, absolute;
};

struct MethodResult {
  std::vector<RunResult> runs;     ///< by repetition
  std::vector<Group> groups;       ///< ascending budgets
  std::optional<SlopeFit> slope;   ///< of rel_mse_corrected over time, where it stands clear of the reference's noise
  std::vector<TimeToError> times;  ///< one for each target
};

struct SceneResult {
  Scene scene;
  Reference reference;
  std::vector<MethodResult> methods;  ///< as in the suite
  /// Methods and budgets that no other one beats in time and error: (method, group).
  std::vector<std::pair<std::size_t, std::size_t>> front;
  std::vector<Ablation> ablations;
};

struct BenchResult {
  Suite suite;
  nlohmann::json machine;
  std::vector<SceneResult> scenes;
  std::vector<Run> schedule;  ///< all runs in the order in which they are made; results point into it
  [[nodiscard]] double seconds(const Sample& sample) const {
    return suite.time == TimeAxis::kCpu ? sample.cpu_seconds : sample.seconds;
  }
  [[nodiscard]] double seconds(const Group& group) const {
    return suite.time == TimeAxis::kCpu ? group.cpu_seconds : group.seconds;
  }
};

/// Reads run.json of a finished run; empty when there is none.
[[nodiscard]] std::optional<RunResult> read_run(const Run& run);
/// Keeps how a run ended: from now on it is finished.
[[nodiscard]] Result<void> write_run(const Run& run, const RenderOutcome& outcome, const Suite& suite,
                                     const Scene& scene);
/// Fills in the errors of a run's images, from errors.json where that fits the reference, else by measuring.
[[nodiscard]] Result<void> measure(RunResult& result, const Reference& reference);
/// Error, the reference's noise taken off, over seconds: means of the budgets.
[[nodiscard]] std::vector<Point> curve_of(const BenchResult& bench, const MethodResult& method);
/// Groups, front, slopes and times, from the runs.
void analyse(BenchResult& result);

}  // namespace pf::bench
