#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "jobs/benchmark/analysis.h"

namespace pf::bench {

/// How long a method took to an error, over the time of the soonest other method.
struct TimeRatio {
  enum class Kind {
    kExact,   ///< both times are known
    kAtMost,  ///< the method was there with its first image
    kAtLeast  ///< it did not get there
  } kind = Kind::kExact;
  double ratio = 0;
  std::size_t soonest = 0;  ///< index of that other method
};

/// What judging a method of type "auto" against the others of the suite found, for one scene.
struct PlannerOfScene {
  std::vector<std::optional<TimeRatio>> targets;  ///< one for each target; empty where no other method got there
  std::optional<TimeRatio> least;  ///< to the least error that another method reached; empty where none has an image
  double least_error = 0;          ///< that error, the reference's noise taken off, but no less than that noise
};

/// Median and worst of ratios; those of kAtLeast count with their bound.
struct RatioSummary {
  double median = 0, worst = 0;
  std::size_t scenes = 0;  ///< that have a ratio; 0: no figures
};

/// Judges method `judged` of a scene; other methods of type "auto" are no rivals.
[[nodiscard]] PlannerOfScene judge_planner(const BenchResult& bench, const SceneResult& scene, std::size_t judged);
[[nodiscard]] RatioSummary summary_of(std::span<const std::optional<TimeRatio>> ratios);

}  // namespace pf::bench
