#include "jobs/benchmark/planner_judgement.h"

#include <algorithm>
#include <cmath>

namespace pf::bench {
namespace {

using Kind = TimeToError::Kind;

std::vector<std::size_t> rivals_of(const BenchResult& bench, const SceneResult& scene) {
  std::vector<std::size_t> rivals;
  for (std::size_t m = 0; m < scene.methods.size(); ++m) {
    if (bench.suite.methods[m].type != "auto" && !scene.methods[m].groups.empty()) rivals.push_back(m);
  }
  return rivals;
}

std::optional<TimeRatio> ratio_to(const BenchResult& bench, const SceneResult& scene, std::size_t judged,
                                  double error) {
  std::optional<std::size_t> soonest;
  double least = INFINITY;
  for (const std::size_t m : rivals_of(bench, scene)) {
    const TimeToError time = time_to_error(curve_of(bench, scene.methods[m]), error);
    if (time.kind == Kind::kNotReached || time.seconds >= least) continue;
    least = time.seconds;
    soonest = m;
  }
  if (!soonest || scene.methods[judged].groups.empty()) return std::nullopt;
  const TimeToError own = time_to_error(curve_of(bench, scene.methods[judged]), error);
  const TimeRatio::Kind kind = own.kind == Kind::kReached       ? TimeRatio::Kind::kExact
                               : own.kind == Kind::kBeforeFirst ? TimeRatio::Kind::kAtMost
                                                                : TimeRatio::Kind::kAtLeast;
  return TimeRatio{kind, own.seconds / least, *soonest};
}

}  // namespace

PlannerOfScene judge_planner(const BenchResult& bench, const SceneResult& scene, std::size_t judged) {
  PlannerOfScene found;
  for (const double target : bench.suite.targets) found.targets.push_back(ratio_to(bench, scene, judged, target));
  found.least_error = INFINITY;
  for (const std::size_t m : rivals_of(bench, scene)) {
    for (const Group& g : scene.methods[m].groups) found.least_error = std::min(found.least_error, g.rel_mse_corrected);
  }
  found.least_error = std::max(found.least_error, scene.reference.noise);  // nothing below it can be told apart
  if (std::isfinite(found.least_error)) found.least = ratio_to(bench, scene, judged, found.least_error);
  return found;
}

RatioSummary summary_of(std::span<const std::optional<TimeRatio>> ratios) {
  std::vector<double> known;
  for (const auto& ratio : ratios) {
    if (ratio) known.push_back(ratio->ratio);
  }
  if (known.empty()) return {};
  std::ranges::sort(known);
  const std::size_t middle = known.size() / 2;
  const double median = known.size() % 2 == 1 ? known[middle] : 0.5 * (known[middle - 1] + known[middle]);
  return {median, known.back(), known.size()};
}

}  // namespace pf::bench
