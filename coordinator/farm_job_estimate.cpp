// What a job has cost so far, and what that says about all of it.

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "common/wire/bundle.h"
#include "common/wire/limits.h"
#include "coordinator/farm_job.h"

namespace pf {
namespace {

/// Doublings of the sub-passes that a job which still runs must have seen: before, the farm has not warmed
/// up.
constexpr std::size_t kEnoughParts = 3;

/// Parts between doublings of the passes: single sub-passes come in bursts, from many workers.
std::vector<PilotPoint> parts_of(const std::vector<ConvergencePoint>& points) {
  std::vector<ConvergencePoint> chosen;
  for (auto point = points.rbegin(); point != points.rend(); ++point) {
    if (chosen.empty() || 2 * point->passes <= chosen.back().passes) chosen.push_back(*point);
  }
  std::reverse(chosen.begin(), chosen.end());
  std::vector<PilotPoint> parts;
  double before = 0;
  for (const ConvergencePoint& point : chosen) {
    parts.push_back({static_cast<double>(point.passes), point.seconds - before, point.estimated_error.value_or(0)});
    before = point.seconds;
  }
  return parts;
}

}  // namespace

void FarmJob::note_memory(std::uint64_t bytes) { worker_bytes_ = std::max(worker_bytes_, bytes); }

Result<Estimate> FarmJob::estimate(const EstimateRequest& asked) const {
  const auto points = convergence();
  if (!points) return tl::unexpected(points.error());
  Estimate estimate;
  PilotRender& pilot = estimate.pilot;
  pilot.points = parts_of(*points);
  if (pilot.points.size() < (ended() ? 1 : kEnoughParts)) {
    return fail(ErrorKind::kUnavailable, fmt::format("{}: too few sub-passes are done to tell; the job is {}",
                                                     record_.id, to_string(record_.state)));
  }
  const bool error_known =
      std::any_of(pilot.points.begin(), pilot.points.end(), [](const PilotPoint& p) { return p.error > 0; });
  const JobSpec& spec = record_.spec;
  PredictionRequest request{.passes = asked.passes,
                            .error = asked.error > 0 ? asked.error : spec.stop.error,
                            .round_growth = spec.integrator.round_growth,
                            .barrier = spec.integrator.mode == ProgressiveMode::kShared};
  if (request.passes <= 0 && !(request.error > 0 && error_known))
    request.passes = static_cast<double>(spec.stop.passes);
  if (request.passes <= 0 && !(request.error > 0 && error_known)) {
    return fail(
        ErrorKind::kInvalidInput,
        fmt::format("{}: neither passes nor a known error bound this job; expected ?passes= or ?error=", record_.id));
  }
  auto results = around_.store.results(record_.number);
  if (!results) return tl::unexpected(results.error());
  for (const CountedResult& result : results_) {
    ++results->count;
    results->workers.insert(result.worker);
  }
  estimate.workers = request.workers = static_cast<int>(std::max<std::size_t>(results->workers.size(), 1));
  pilot.peak_bytes = worker_bytes_;
  pilot.result_bytes = figures().bytes_received / std::max<std::uint64_t>(results->count, 1);
  pilot.state_bytes = state_bytes_.value_or(0);
  const auto manifest = around_.blobs.read(record_.bundle, 0, kMaxBundleBytes);
  const auto files = manifest ? files_of_bundle(*manifest) : tl::unexpected(manifest.error());
  for (const auto& [path, blob] : files ? *files : FileList()) pilot.scene_bytes += blob.bytes;
  estimate.prediction = predict(pilot, request);
  if (!files || !state_bytes_) estimate.prediction.network_bytes = {};  // not known any more
  return estimate;
}

}  // namespace pf
