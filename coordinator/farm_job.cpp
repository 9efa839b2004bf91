#include "coordinator/farm_job.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "common/film/render_result.h"
#include "common/wire/limits.h"

namespace pf {
namespace {

/// A unit should trace about this long [s]: short enough to share out a round evenly, long against a fetch (1
/// ms).
constexpr double kUnitSeconds = 0.25;
/// The same of a job with a bound on its workers: these cannot gather units before they send, for the next
/// one could be another's.
constexpr double kBoundedUnitSeconds = 4.0;
/// A unit in the queue that no worker has, while workers idle: after this many AckWaits the engine has lost
/// it.
constexpr double kLostAckWaits = 3.0;
constexpr double kDiskRetrySeconds = 2.0;
/// Deaths of workers that trace a unit, per permitted failure: a worker may die for reasons of its own.
constexpr std::uint32_t kDeathsPerFailure = 4;

}  // namespace

FarmJob::FarmJob(JobRecord record, std::filesystem::path folder, const JobSurroundings& around)
    : record_(std::move(record)),
      spec_hash_(image_hash_of_spec(record_.spec)),
      folder_(std::move(folder)),
      around_(around),
      frozen_limit_(kNoEnd) {}

void FarmJob::log(std::string_view level, std::string_view source, std::string_view text) const {
  around_.log(record_.id, level, source, text);
}

double FarmJob::seconds() const {
  return seconds_before_ + (running_since_ > 0 ? around_.clock.now() - running_since_ : 0.0);
}

void FarmJob::stop_clock() {
  seconds_before_ = seconds();
  running_since_ = 0;
}

bool FarmJob::has_barrier() const { return shares_radii() || record_.spec.stop.error > 0; }

std::uint64_t FarmJob::limit() const {
  std::uint64_t limit = frozen_limit_;
  limit = std::min(limit, wanted_sub_passes());
  return has_barrier() ? std::min(limit, film_->round_end()) : limit;
}

std::uint64_t FarmJob::wanted_sub_passes() const {
  const auto passes = static_cast<std::uint64_t>(record_.spec.stop.passes);
  return passes > 0 ? film_->order().sub_passes(passes) : kNoEnd;
}

std::vector<std::string_view> FarmJob::holders() const {
  std::vector<std::string_view> names;
  for (const auto& [first, unit] : ledger_.out()) {
    if (!unit.holder.empty()) names.push_back(unit.holder);
  }
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

std::size_t FarmJob::room_for_workers() const {
  if (record_.max_workers == 0) return std::numeric_limits<std::size_t>::max();
  const std::size_t taken = holders().size() + ledger_.queued();
  const auto most = static_cast<std::size_t>(record_.max_workers);
  return most > taken ? most - taken : 0;
}

std::uint64_t FarmJob::unit_size(std::size_t workers) const {
  const bool bounded = record_.max_workers > 0;
  if (bounded) workers = std::min(workers, static_cast<std::size_t>(record_.max_workers));
  const std::uint64_t left = limit() - ledger_.issued_below();
  // Two units a worker and round at least, so that the last ones end together.
  const std::uint64_t fair = std::max<std::uint64_t>(1, left / (2 * std::max<std::size_t>(workers, 1)));
  if (sub_pass_seconds_ <= 0) return 1;
  const double wanted =
      std::clamp(std::floor((bounded ? kBoundedUnitSeconds : kUnitSeconds) / sub_pass_seconds_), 1.0, 1e6);
  return std::min(fair, static_cast<std::uint64_t>(wanted));
}

wire::Task FarmJob::make_task(wire::Task::Kind kind, const UnitLedger::Out& unit) const {
  wire::Task task;
  task.set_version(kWireVersion);
  task.set_build_id(around_.build_id);
  task.set_run(record_.run);
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
    apply(JobEvent::kPrepare, "");
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
  if (ledger_.issued_below() >= limit() || room_for_workers() == 0) return std::nullopt;
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

std::size_t FarmJob::queued() const { return ledger_.queued() + (preparing_ && preparing_->holder.empty() ? 1 : 0); }

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
      fmt::format("sub-passes {} to {} go out again (attempt {}): {}", unit.range.first, unit.range.end(),
                  unit.attempt + 1, why));
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
    if (unit.holder.empty())
      return now - unit.since > lost_after && idle_since(now - around_.ack_wait_seconds) ? "lost" : "";
    return now - unit.since > timeout ? "timeout" : "";
  };
  if (preparing_ && !repeat_preparing_ && !judge(*preparing_).empty()) repeat_prepare();
  std::vector<std::pair<std::uint64_t, std::string_view>> due;
  for (const auto& [first, unit] : ledger_.out()) {
    if (const auto why = judge(unit);
        !why.empty() && std::find(repeat_.begin(), repeat_.end(), first) == repeat_.end()) {
      due.emplace_back(first, why);
    }
  }
  for (const auto& [first, why] : due) {
    UnitLedger::Out& unit = *ledger_.find(first);
    if (why == "timeout" && ++unit.failures >= static_cast<std::uint32_t>(record_.spec.faults.max_attempts)) {
      return end_failed(
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
  if (failed.permanent()) return end_failed(fmt::format("{}: {}", worker, failed.message()));
  UnitLedger::Out* unit = failed.kind() == wire::Task::PREPARE ? (preparing_ ? &*preparing_ : nullptr)
                                                               : ledger_.find(failed.unit().first_sub_pass());
  if (unit == nullptr || unit->attempt != failed.unit().attempt()) return;
  if (++unit->failures >= static_cast<std::uint32_t>(record_.spec.faults.max_attempts)) {
    return end_failed(fmt::format("{} attempts failed, the last on {}: {}", unit->failures, worker, failed.message()));
  }
  if (failed.kind() == wire::Task::PREPARE) {
    repeat_prepare();
  } else {
    repeat_unit(*unit, failed.message());
  }
}

void FarmJob::forget_intakes(const std::string& worker) {
  std::erase_if(intakes_, [&](const auto& entry) { return std::get<0>(entry.first) == worker; });
}

void FarmJob::forget_worker(const std::string& worker) {
  forget_intakes(worker);
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
    return end_failed(overflow_message(record_.spec.job.name, film_->sums().faults.overflow));
  }
  note_point();
  if (film_->round_begin() != round) {
    stop_by_error();
    if (shares_radii() && ledger_.issued_below() < std::min(frozen_limit_, limit())) {
      if (auto written = write_state(); !written) wait_for_disk(written.error());
    }
  }
}

/// No sub-pass beyond a round's end at which the estimated error was small enough.
void FarmJob::stop_by_error() {
  const std::uint64_t done = film_->sub_passes();
  if (record_.spec.stop.error <= 0 || done < 2 || done != film_->round_begin()) return;
  record_.estimated_error = film_->estimated_error();
  if (record_.estimated_error <= record_.spec.stop.error) frozen_limit_ = std::min(frozen_limit_, done);
}

void FarmJob::go_on_after_waiting(double now) {
  apply(state_before_waiting_ == JobState::kPreparing   ? JobEvent::kGoOnPreparing
        : state_before_waiting_ == JobState::kFinishing ? JobEvent::kGoOnFinishing
                                                        : JobEvent::kGoOnRunning,
        "");
  log("info", "coordinator", "there is space again: the job goes on");
  // Nothing was taken in meanwhile: that is no fault of those who have units.
  std::vector<std::uint64_t> out;
  for (const auto& [first, unit] : ledger_.out()) out.push_back(first);
  for (const std::uint64_t first : out) ledger_.find(first)->since = now;
  if (preparing_) preparing_->since = now;
}

void FarmJob::tick(const std::function<bool(double since)>& idle_since) {
  const double now = around_.clock.now();
  if (unsaved_record_ && now >= next_save_) {
    next_save_ = now + kDiskRetrySeconds;
    save_record();
  }
  if (ended()) return;
  if (record_.state == JobState::kPaused && film_ && film_->sub_passes() != checkpointed_passes_ && now >= next_try_) {
    next_try_ = now + kDiskRetrySeconds;
    static_cast<void>(save_checkpoint());  // the disk was full when it was paused
  }
  if (record_.state == JobState::kWaiting) {
    if (now < next_try_) return;
    next_try_ = now + kDiskRetrySeconds;
    const bool finishing = state_before_waiting_ == JobState::kFinishing;
    auto saved = film_ ? save_checkpoint() : Result<void>{};
    if (saved && !finishing && lacks_state()) saved = write_state();
    if (!saved) return;
    go_on_after_waiting(now);
  }
  if (record_.state == JobState::kFinishing) return go_on_finishing();
  if (record_.state == JobState::kPreparing || record_.state == JobState::kRunning) look_after_units(now, idle_since);
  if (record_.state != JobState::kRunning) return;
  if (record_.spec.stop.seconds > 0 && ledger_.done_below() > 0 && seconds() >= record_.spec.stop.seconds) {
    frozen_limit_ = std::min(frozen_limit_, ledger_.issued_below());
  }
  const std::uint64_t end = std::min(frozen_limit_, wanted_sub_passes());
  if (ledger_.done_below() >= end && ledger_.out().empty()) return finish(JobEvent::kFinish, "");
  if (now - last_checkpoint_ < record_.spec.checkpoint.seconds || film_->sub_passes() == checkpointed_passes_) return;
  if (auto saved = save_checkpoint(); !saved) wait_for_disk(saved.error());
}

}  // namespace pf
