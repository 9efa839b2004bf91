// A job as users see it.

#include <cmath>

#include "coordinator/farm_job.h"

namespace pf {

JobRecord::Figures FarmJob::figures() const {
  if (!film_) return record_.figures;
  const Statistics& sums = film_->sums();
  return {film_->order().mean_passes(sums.sub_passes),
          film_->rounds(),
          sums.rays,
          sums.photon_paths,
          seconds(),
          units_done_,
          units_repeated_,
          bytes_received_,
          merge_seconds_};
}

JobView FarmJob::view() const {
  JobView v;
  const JobSpec& spec = record_.spec;
  v.id = record_.id;
  v.name = spec.job.name;
  v.state = record_.state;
  v.message = record_.message;
  v.priority = spec.job.priority;
  v.max_workers = record_.max_workers;
  v.submitted_by = record_.submitted_by;
  v.paused_by = record_.paused_by;
  v.extended = record_.extended;
  v.expired = record_.expired;
  v.algorithm = record_.plan.substr(0, record_.plan.find_first_of(" ;,:"));
  v.width = spec.image.width;
  v.height = spec.image.height;
  v.passes_wanted = static_cast<std::uint64_t>(spec.stop.passes);
  v.stop_seconds = spec.stop.seconds;
  v.stop_error = spec.stop.error;
  if (record_.estimated_error >= 0 && std::isfinite(record_.estimated_error))
    v.estimated_error = record_.estimated_error;
  const JobRecord::Figures figures = this->figures();
  v.seconds = figures.seconds;
  v.passes_done = figures.passes;
  v.rounds = figures.rounds;
  v.rays = figures.rays;
  v.photon_paths = figures.photon_paths;
  if (v.seconds > 0) {
    v.rays_per_second = static_cast<double>(v.rays) / v.seconds;
    v.passes_per_second = static_cast<double>(v.passes_done) / v.seconds;
  }
  if (!ended() && v.passes_wanted > v.passes_done && v.passes_per_second > 0) {
    v.seconds_left = static_cast<double>(v.passes_wanted - v.passes_done) / v.passes_per_second;
  }
  v.workers = static_cast<int>(holders().size());
  v.units_done = figures.units_done;
  v.units_repeated = figures.units_repeated;
  v.bytes_received = figures.bytes_received;
  v.merge_seconds = figures.merge_seconds;
  v.image_hash = record_.image_hash;
  v.scene_hash = record_.scene_hash;
  v.spec_hash = spec_hash_;
  v.warnings = record_.warnings;
  v.submitted_unix_ms = record_.submitted_unix_ms;
  v.started_unix_ms = record_.started_unix_ms;
  v.ended_unix_ms = record_.ended_unix_ms;
  return v;
}

}  // namespace pf
