// What befalls a job as a whole: each change of its state by the table of job_state.h, and what belongs to
// it.

#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "coordinator/farm_job.h"

namespace pf {
namespace {

constexpr int kMaxWorkers = 4096;

tl::unexpected<Error> conflict(const std::string& id, const std::string& why) {
  return fail(ErrorKind::kUnavailable, fmt::format("{}: {}", id, why));
}

std::string by_whom(JobEvent event, const std::string& by) {
  return fmt::format("{}{}{}", to_string(event), by.empty() ? "" : ", by ", by);
}

}  // namespace

void FarmJob::apply(JobEvent event, const std::string& message, const std::string& by) {
  const JobStep step = job_step(record_.state, event);
  if (step.kind == JobStep::Kind::kRefused)
    return log("error", "coordinator", "a bug: " + why_refused(record_.state, event));
  const JobState from = record_.state;
  if (step.kind == JobStep::Kind::kMoves) record_.state = step.to;
  transitions_.push_back({around_.unix_ms(), event, from, record_.state, by});
  if (step.kind == JobStep::Kind::kMoves || !message.empty()) record_.message = message;
  if (cause_of(event) != JobCause::kFarm) log("info", "coordinator", by_whom(event, by));
  save_record();
}

void FarmJob::save_record() {
  const auto saved = around_.store.save(record_, transitions_);
  if (saved) transitions_.clear();
  // A job that waits for the disk has said why already.
  if (!saved && !unsaved_record_ && record_.state != JobState::kWaiting)
    log("error", "coordinator", saved.error().message);
  unsaved_record_ = !saved;
}

Result<void> FarmJob::act(JobEvent verb, const std::string& by) {
  const JobStep step = job_step(record_.state, verb);
  if (step.kind == JobStep::Kind::kRefused) return conflict(record_.id, why_refused(record_.state, verb));
  switch (verb) {
    case JobEvent::kPause:
      if (step.kind == JobStep::Kind::kMoves) pause(by);
      return {};
    case JobEvent::kRetry:
      if (record_.bundle.bytes == 0) return conflict(record_.id, "its scene is not kept any more; submit it again");
      begin_again(verb, by);
      return {};
    case JobEvent::kResume:
      if (step.kind == JobStep::Kind::kMoves) begin_again(verb, by);
      return {};
    case JobEvent::kCancel:
      if (step.kind == JobStep::Kind::kMoves) finish(verb, "cancelled", by);
      return {};
    case JobEvent::kDiscard:
      discard(by);
      return {};
    default:
      return fail(ErrorKind::kInternal, fmt::format("{} is no verb", to_string(verb)));
  }
}

void FarmJob::take_back() {
  intakes_.clear();
  ledger_.restore(ledger_.done_below(), ledger_.done_beyond());
  repeat_.clear();
  repeat_preparing_ = false;
  preparing_.reset();
}

void FarmJob::pause(const std::string& by) {
  take_back();
  stop_clock();
  record_.paused_by = by;
  if (film_) {
    if (auto saved = save_checkpoint(); !saved) log("error", "coordinator", saved.error().message);
  }
  apply(JobEvent::kPause, "", by);
}

/// Also from the beginning, when there is no checkpoint.
void FarmJob::begin_again(JobEvent event, const std::string& by) {
  ++record_.run;
  record_.paused_by.clear();
  record_.image_hash.clear();
  record_.expired.clear();
  record_.ended_unix_ms = 0;
  record_.end_state = JobState::kDone;
  frozen_limit_ = kNoEnd;
  apply(event, "", by);
  auto loaded = load_checkpoint();
  if (loaded && *loaded) return take_up();
  if (loaded) return;
  if (event == JobEvent::kResume) return end_failed(loaded.error().message);
  log("warning", "coordinator", fmt::format("{}; the job starts from the beginning", loaded.error().message));
}

/// A queued job with a film goes on.
void FarmJob::take_up() {
  running_since_ = last_checkpoint_ = around_.clock.now();
  apply(JobEvent::kTakeUp, "");
  log("info", "coordinator", fmt::format("goes on from a checkpoint of {} sub-passes", film_->sub_passes()));
  stop_by_error();
  if (auto written = write_state(); !written) wait_for_disk(written.error());
}

Result<void> FarmJob::extend(const StopChange& change, const std::string& by) {
  if (job_step(record_.state, JobEvent::kExtend).kind == JobStep::Kind::kRefused) {
    return conflict(record_.id, why_refused(record_.state, JobEvent::kExtend));
  }
  if (record_.bundle.bytes == 0) return conflict(record_.id, "its scene is not kept any more; submit it again");
  JobSpec spec = record_.spec;
  if (change.passes) {
    const std::int64_t before = spec.stop.passes;
    const auto passes = static_cast<std::int64_t>(view().passes_done);
    if (*change.passes != 0 && (before != 0 ? *change.passes <= before : *change.passes <= passes)) {
      return fail(ErrorKind::kInvalidInput, fmt::format("passes: {} given; expected more than {}, or 0 for no bound",
                                                        *change.passes, before != 0 ? before : passes));
    }
    spec.stop.passes = *change.passes;
  }
  if (change.seconds) spec.stop.seconds = *change.seconds;
  if (change.error) spec.stop.error = *change.error;
  auto checked = parse_job_json(canonical_json(spec), "stop");
  if (!checked) return fail(ErrorKind::kInvalidInput, checked.error().message);
  if (ended()) {
    const auto loaded = load_checkpoint();
    if (!loaded) return conflict(record_.id, loaded.error().message);
    if (!*loaded && record_.state == JobState::kDone) {
      return conflict(record_.id, "its checkpoint has expired; submit it again with the new stops");
    }
  }
  record_.spec.stop = spec.stop;
  ++record_.extended;
  if (ended()) {
    begin_again(JobEvent::kExtend, by);
  } else {
    frozen_limit_ = kNoEnd;
    apply(JobEvent::kExtend, "", by);
    if (film_) stop_by_error();
  }
  return {};
}

Result<void> FarmJob::change(const JobChange& change, const std::string& by) {
  constexpr int kMaxPriority = 100;
  if (change.priority && (*change.priority < 0 || *change.priority > kMaxPriority)) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("priority: {} given; expected 0 to {}", *change.priority, kMaxPriority));
  }
  if (change.max_workers && (*change.max_workers < 0 || *change.max_workers > kMaxWorkers)) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("max_workers: {} given; expected 0 (no bound) to {}", *change.max_workers, kMaxWorkers));
  }
  if (change.priority) record_.spec.job.priority = *change.priority;
  if (change.max_workers) record_.max_workers = *change.max_workers;
  apply(JobEvent::kChange, "", by);
  return {};
}

void FarmJob::discard(const std::string& by) {
  take_back();
  stop_clock();
  if (film_) record_.figures = figures();
  film_.reset();
  remove_image();
  remove_checkpoint();
  drop_state();
  record_.image_hash.clear();
  record_.bundle = {};
  record_.paused_by.clear();
  if (!ended()) record_.ended_unix_ms = around_.unix_ms();
  apply(JobEvent::kDiscard, "discarded", by);
}

void FarmJob::finish(JobEvent event, const std::string& message, const std::string& by) {
  record_.end_state = event == JobEvent::kCancel ? JobState::kCancelled : JobState::kDone;
  record_.paused_by.clear();
  take_back();
  stop_clock();
  apply(event, message, by);
  go_on_finishing();
}

void FarmJob::go_on_finishing() {
  if (film_ && film_->sub_passes() > 0) {
    if (auto written = write_result(); !written) return wait_for_disk(written.error());
  }
  const bool cancelled = record_.end_state == JobState::kCancelled;
  end(cancelled ? JobEvent::kEndCancelled : JobEvent::kComplete, cancelled ? "cancelled" : "");
}

void FarmJob::end_failed(const std::string& message) {
  take_back();
  stop_clock();
  // A failed job keeps what was reached; that this may fail too is of no account any more.
  if (film_) static_cast<void>(save_checkpoint());
  end(JobEvent::kFail, message);
}

void FarmJob::end(JobEvent event, const std::string& message) {
  if (film_) record_.figures = figures();
  film_.reset();
  record_.ended_unix_ms = around_.unix_ms();
  apply(event, message);
  log(event == JobEvent::kFail ? "error" : "info", "coordinator",
      fmt::format("{}{}{}", to_string(record_.state),
                  message.empty() || message == to_string(record_.state) ? "" : ": ",
                  message == to_string(record_.state) ? "" : message));
  drop_state();
}

void FarmJob::take_from(const std::string& worker, std::string_view why) {
  forget_intakes(worker);
  std::vector<std::uint64_t> its;
  for (const auto& [first, unit] : ledger_.out()) {
    if (unit.holder == worker) its.push_back(first);
  }
  for (const std::uint64_t first : its) repeat_unit(*ledger_.find(first), why);
  if (preparing_ && preparing_->holder == worker) repeat_prepare();
}

}  // namespace pf
