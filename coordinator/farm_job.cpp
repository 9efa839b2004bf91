#include "coordinator/farm_job.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "common/film/render_result.h"
#include "common/wire/limits.h"

namespace pf {
namespace {

constexpr std::uint64_t kNoLimit = std::numeric_limits<std::uint64_t>::max();
/// A unit should trace about this long [s]: short enough to share out a round evenly, long against a fetch (1 ms).
constexpr double kUnitSeconds = 0.25;
/// A unit in the queue that no worker has, while workers idle: after this many AckWaits the engine has lost it.
constexpr double kLostAckWaits = 3.0;
constexpr double kDiskRetrySeconds = 2.0;
/// Deaths of workers that trace a unit, per permitted failure: a worker may die for reasons of its own.
constexpr std::uint32_t kDeathsPerFailure = 4;

}  // namespace

FarmJob::FarmJob(JobRecord record, std::filesystem::path folder, const JobSurroundings& around)
    : record_(std::move(record)), folder_(std::move(folder)), around_(around), frozen_limit_(kNoLimit) {}

void FarmJob::log(std::string_view level, std::string_view source, std::string_view text) const {
  around_.log(record_.id, level, source, text);
}

double FarmJob::seconds() const {
  return seconds_before_ + (running_since_ > 0 ? around_.clock.now() - running_since_ : 0.0);
}

bool FarmJob::has_barrier() const { return shares_radii() || record_.spec.stop.error > 0; }

std::uint64_t FarmJob::limit() const {
  std::uint64_t limit = frozen_limit_;
  limit = std::min(limit, wanted_sub_passes());
  return has_barrier() ? std::min(limit, film_->round_end()) : limit;
}

std::uint64_t FarmJob::wanted_sub_passes() const {
  const auto passes = static_cast<std::uint64_t>(record_.spec.stop.passes);
  return passes > 0 ? film_->order().sub_passes(passes) : kNoLimit;
}

std::uint64_t FarmJob::unit_size(std::size_t workers) const {
  const std::uint64_t left = limit() - ledger_.issued_below();
  // Two units a worker and round at least, so that the last ones end together.
  const std::uint64_t fair = std::max<std::uint64_t>(1, left / (2 * std::max<std::size_t>(workers, 1)));
  if (sub_pass_seconds_ <= 0) return 1;
  const double wanted = std::clamp(std::floor(kUnitSeconds / sub_pass_seconds_), 1.0, 1e6);
  return std::min(fair, static_cast<std::uint64_t>(wanted));
}

wire::Task FarmJob::make_task(wire::Task::Kind kind, const UnitLedger::Out& unit) const {
  wire::Task task;
  task.set_version(kWireVersion);
  task.set_build_id(around_.build_id);
  task.set_job_id(record_.id);
  task.set_kind(kind);
  task.mutable_unit()->set_first_sub_pass(unit.range.first);
  task.mutable_unit()->set_sub_passes(unit.range.count);
  task.mutable_unit()->set_attempt(unit.attempt);
  task.mutable_bundle()->set_sha256(sha256_bytes(record_.bundle.sha256));
  task.mutable_bundle()->set_bytes(record_.bundle.bytes);
  task.set_timeout_seconds(record_.spec.faults.unit_timeout_seconds);
  task.set_width(static_cast<std::uint32_t>(record_.spec.image.width * (film_ ? film_->options().hit_points : 1)));
  task.set_height(static_cast<std::uint32_t>(record_.spec.image.height));
  if (kind == wire::Task::SUB_PASSES) {
    // Without shared radii units of several rounds are out at once, and may be merged.
    if (shares_radii()) task.set_round_begin(film_->round_begin());
    if (state_.bytes > 0) {
      task.mutable_state()->set_sha256(sha256_bytes(state_.sha256));
      task.mutable_state()->set_bytes(state_.bytes);
    }
  }
  return task;
}

std::optional<wire::Task> FarmJob::next_task(std::size_t workers) {
  const double now = around_.clock.now();
  if (record_.state == JobState::kQueued) {
    preparing_ = UnitLedger::Out{.range = {}, .attempt = 1, .since = now, .holder = {}, .failures = 0};
    set_state(JobState::kPreparing, "");
    return make_task(wire::Task::PREPARE, *preparing_);
  }
  if (record_.state == JobState::kPreparing && std::exchange(repeat_preparing_, false)) {
    return make_task(wire::Task::PREPARE, *preparing_);
  }
  if (record_.state != JobState::kRunning) return std::nullopt;
  while (!repeat_.empty()) {
    const UnitLedger::Out* unit = ledger_.find(repeat_.front());
    repeat_.pop_front();
    if (unit != nullptr) return make_task(wire::Task::SUB_PASSES, *unit);
  }
  if (ledger_.issued_below() >= limit()) return std::nullopt;
  const auto range = ledger_.issue(unit_size(workers), limit(), now);
  if (!range) return std::nullopt;
  return make_task(wire::Task::SUB_PASSES, *ledger_.find(range->first));
}

void FarmJob::not_published(const wire::Task& task) {
  if (task.kind() == wire::Task::PREPARE) {
    repeat_preparing_ = true;
  } else {
    repeat_.push_back(task.unit().first_sub_pass());
  }
}

std::size_t FarmJob::queued() const {
  return ledger_.queued() + (preparing_ && preparing_->holder.empty() ? 1 : 0);
}

double FarmJob::cost(const wire::Task& task) const {
  const double passes = task.kind() == wire::Task::PREPARE ? 1.0 : static_cast<double>(task.unit().sub_passes());
  return passes * (sub_pass_seconds_ > 0 ? sub_pass_seconds_ : kUnitSeconds);
}

void FarmJob::on_held(const std::string& worker, const std::vector<UnitRange>& held, bool preparing) {
  const double now = around_.clock.now();
  if (preparing_) {
    if (preparing && preparing_->holder != worker) {
      preparing_->holder = worker;
      preparing_->since = now;
    } else if (!preparing && preparing_->holder == worker) {
      preparing_->holder.clear();
      preparing_->since = now;
    }
  }
  for (const UnitRange& range : held) {
    UnitLedger::Out* unit = ledger_.find(range.first);
    if (unit == nullptr || unit->range != range || unit->holder == worker) continue;
    unit->holder = worker;
    unit->since = now;
  }
  std::vector<std::uint64_t> let_go;
  for (const auto& [first, unit] : ledger_.out()) {
    if (unit.holder == worker && std::find(held.begin(), held.end(), unit.range) == held.end()) let_go.push_back(first);
  }
  for (const std::uint64_t first : let_go) {
    ledger_.find(first)->holder.clear();
    ledger_.find(first)->since = now;
  }
}

void FarmJob::repeat_unit(UnitLedger::Out& unit, std::string_view why) {
  ++units_repeated_;
  ++around_.metrics.retries;
  log("info", "coordinator",
      fmt::format("sub-passes {} to {} go out again (attempt {}): {}", unit.range.first, unit.range.end(), unit.attempt + 1, why));
  ledger_.reissue(unit.range.first, around_.clock.now());
  repeat_.push_back(unit.range.first);
}

void FarmJob::repeat_prepare() {
  ++preparing_->attempt;  // the engine takes no task twice
  preparing_->holder.clear();
  preparing_->since = around_.clock.now();
  repeat_preparing_ = true;
}

void FarmJob::look_after_units(double now, const std::function<bool(double since)>& idle_since) {
  const double lost_after = kLostAckWaits * around_.ack_wait_seconds;
  const double timeout = record_.spec.faults.unit_timeout_seconds;
  const auto judge = [&](const UnitLedger::Out& unit) -> std::string_view {
    if (unit.holder.empty()) return now - unit.since > lost_after && idle_since(now - around_.ack_wait_seconds) ? "lost" : "";
    return now - unit.since > timeout ? "timeout" : "";
  };
  if (preparing_ && !repeat_preparing_ && !judge(*preparing_).empty()) repeat_prepare();
  std::vector<std::pair<std::uint64_t, std::string_view>> due;
  for (const auto& [first, unit] : ledger_.out()) {
    if (const auto why = judge(unit); !why.empty() && std::find(repeat_.begin(), repeat_.end(), first) == repeat_.end()) {
      due.emplace_back(first, why);
    }
  }
  for (const auto& [first, why] : due) {
    UnitLedger::Out& unit = *ledger_.find(first);
    if (why == "timeout" && ++unit.failures >= static_cast<std::uint32_t>(record_.spec.faults.max_attempts)) {
      return finish(JobState::kFailed,
                    fmt::format("sub-pass {} was not done within {} s in {} attempts; see faults.unit_timeout_seconds", first,
                                timeout, unit.failures));
    }
    repeat_unit(unit, why == "timeout" ? fmt::format("{} has had it for more than {} s", unit.holder, timeout)
                                       : std::string("it left the queue and no worker has it"));
  }
}

void FarmJob::on_failed(const std::string& worker, const wire::TaskFailed& failed) {
  if (ended()) return;
  log("warning", worker, failed.message());
  if (failed.permanent()) return finish(JobState::kFailed, fmt::format("{}: {}", worker, failed.message()));
  UnitLedger::Out* unit = failed.kind() == wire::Task::PREPARE ? (preparing_ ? &*preparing_ : nullptr)
                                                               : ledger_.find(failed.unit().first_sub_pass());
  if (unit == nullptr || unit->attempt != failed.unit().attempt()) return;
  if (++unit->failures >= static_cast<std::uint32_t>(record_.spec.faults.max_attempts)) {
    return finish(JobState::kFailed,
                  fmt::format("{} attempts failed, the last on {}: {}", unit->failures, worker, failed.message()));
  }
  if (failed.kind() == wire::Task::PREPARE) {
    repeat_prepare();
  } else {
    repeat_unit(*unit, failed.message());
  }
}

void FarmJob::forget_worker(const std::string& worker) {
  std::erase_if(intakes_, [&](const auto& entry) { return std::get<0>(entry.first) == worker; });
  for (const auto& [first, unit] : ledger_.out()) {
    if (unit.holder != worker) continue;
    UnitLedger::Out& mine = *ledger_.find(first);
    mine.holder.clear();
    mine.since = around_.clock.now();
  }
  if (preparing_ && preparing_->holder == worker) preparing_->holder.clear();
}

void FarmJob::after_progress() {
  const std::uint64_t round = film_->round_begin(), rounds = film_->rounds();
  film_->close_round_if_complete();
  around_.metrics.rounds += film_->rounds() - rounds;
  if (film_->sums().faults.overflow > 0) {
    return finish(JobState::kFailed, overflow_message(record_.spec.job.name, film_->sums().faults.overflow));
  }
  if (film_->round_begin() != round) {
    const std::uint64_t done = film_->sub_passes();
    if (record_.spec.stop.error > 0 || film_->rounds() % 4 == 0) record_.estimated_error = film_->estimated_error();
    if (record_.spec.stop.error > 0 && done >= 2 && done == film_->round_begin() &&
        record_.estimated_error <= record_.spec.stop.error) {
      frozen_limit_ = std::min(frozen_limit_, done);
    }
    if (shares_radii() && ledger_.issued_below() < std::min(frozen_limit_, limit())) {
      if (auto written = write_state(); !written) wait_for_disk(written.error());
    }
  }
}

void FarmJob::go_on_after_waiting(double now) {
  set_state(state_before_waiting_, "");
  log("info", "coordinator", "there is space again: the job goes on");
  // Nothing was taken in meanwhile: that is no fault of those who have units.
  std::vector<std::uint64_t> out;
  for (const auto& [first, unit] : ledger_.out()) out.push_back(first);
  for (const std::uint64_t first : out) ledger_.find(first)->since = now;
  if (preparing_) preparing_->since = now;
}

void FarmJob::tick(const std::function<bool(double since)>& idle_since) {
  if (ended()) return;
  const double now = around_.clock.now();
  if (record_.state == JobState::kWaiting) {
    if (now < next_try_) return;
    next_try_ = now + kDiskRetrySeconds;
    const bool finishing = state_before_waiting_ == JobState::kFinishing;
    auto saved = film_ ? save_checkpoint() : Result<void>{};
    if (saved && !finishing && lacks_state()) saved = write_state();
    if (!saved) return;
    go_on_after_waiting(now);
  }
  if (record_.state == JobState::kFinishing) return finish(record_.end_state, end_message_);
  if (record_.state == JobState::kPreparing || record_.state == JobState::kRunning) look_after_units(now, idle_since);
  if (record_.state != JobState::kRunning) return;
  if (record_.spec.stop.seconds > 0 && ledger_.done_below() > 0 && seconds() >= record_.spec.stop.seconds) {
    frozen_limit_ = std::min(frozen_limit_, ledger_.issued_below());
  }
  const std::uint64_t end = std::min(frozen_limit_, wanted_sub_passes());
  if (ledger_.done_below() >= end && ledger_.out().empty()) return finish(JobState::kDone, "");
  if (now - last_checkpoint_ < record_.spec.checkpoint.seconds || film_->sub_passes() == checkpointed_passes_) return;
  if (auto saved = save_checkpoint(); !saved) wait_for_disk(saved.error());
}

void FarmJob::cancel() {
  if (!ended()) finish(JobState::kCancelled, "cancelled");
}

JobRecord::Figures FarmJob::figures_of_film() const {
  const Statistics& sums = film_->sums();
  return {film_->order().mean_passes(sums.sub_passes), film_->rounds(), sums.rays, sums.photon_paths, seconds()};
}

JobView FarmJob::view() const {
  JobView v;
  const JobSpec& spec = record_.spec;
  v.id = record_.id;
  v.name = spec.job.name;
  v.state = record_.state;
  v.message = record_.message;
  v.priority = spec.job.priority;
  v.algorithm = record_.plan.substr(0, record_.plan.find_first_of(" ;,:"));
  v.width = spec.image.width;
  v.height = spec.image.height;
  v.passes_wanted = static_cast<std::uint64_t>(spec.stop.passes);
  v.stop_seconds = spec.stop.seconds;
  v.stop_error = spec.stop.error;
  v.seconds = ended() ? record_.figures.seconds : seconds();
  if (record_.estimated_error >= 0 && std::isfinite(record_.estimated_error)) v.estimated_error = record_.estimated_error;
  const JobRecord::Figures figures = film_ ? figures_of_film() : record_.figures;
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
  std::vector<std::string_view> holders;
  for (const auto& [first, unit] : ledger_.out()) {
    if (!unit.holder.empty()) holders.push_back(unit.holder);
  }
  std::sort(holders.begin(), holders.end());
  v.workers = static_cast<int>(std::unique(holders.begin(), holders.end()) - holders.begin());
  v.units_done = units_done_;
  v.units_repeated = units_repeated_;
  v.bytes_received = bytes_received_;
  v.merge_seconds = merge_seconds_;
  v.image_hash = record_.image_hash;
  v.scene_hash = record_.scene_hash;
  v.spec_hash = image_hash_of_spec(spec);
  v.warnings = record_.warnings;
  v.submitted_unix_ms = record_.submitted_unix_ms;
  v.started_unix_ms = record_.started_unix_ms;
  v.ended_unix_ms = record_.ended_unix_ms;
  return v;
}

}  // namespace pf
