#include "worker/farm/session.h"

#include <algorithm>

#include <fmt/format.h>

#include "common/base/memory.h"
#include "common/wire/bundle.h"
#include "common/wire/limits.h"

namespace pf {
namespace {

constexpr double kFetchSeconds = 5.0;
constexpr double kHeartbeatSeconds = 2.0;
constexpr double kRepeatSeconds = 2.0;  ///< a question without an answer is asked again
constexpr double kDrainSeconds = 60.0;  ///< a result that nobody takes is given up then
constexpr std::size_t kRememberedJobs = 64;

}  // namespace

Session::Session(SessionOptions options, WorkerPort& port, Executor& executor, BlobStore& blobs, const Clock& clock,
                 const Log& log)
    : options_(std::move(options)), port_(port), executor_(executor), blobs_(blobs), clock_(clock), log_(log) {}

void Session::start() {
  // What a killed process of this name has left.
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(options_.cache, ignored)) {
    if (entry.path().filename().string().starts_with(options_.name + "."))
      std::filesystem::remove_all(entry.path(), ignored);
  }
  send_heartbeat();
}

void Session::send(wire::FromWorker& message) {
  message.set_version(kWireVersion);
  message.set_worker(options_.name);
  message.set_incarnation(options_.incarnation);
  port_.send(to_bytes(message));
}

void Session::send_heartbeat() {
  wire::FromWorker message;
  wire::Heartbeat& h = *message.mutable_heartbeat();
  h.set_host(options_.host);
  h.set_process(options_.process);
  h.set_threads(options_.threads);
  h.set_build_id(options_.build_id);
  h.set_activity(draining_                       ? wire::Heartbeat::DRAINING
                 : current_ && current_->working ? wire::Heartbeat::TRACING
                 : current_                      ? wire::Heartbeat::LOADING
                 : held_ || !outgoing_.empty()   ? wire::Heartbeat::SENDING
                                                 : wire::Heartbeat::IDLE);
  const auto add = [&](const std::string& job, const wire::Unit& unit) {
    if (h.job_id().empty()) h.set_job_id(job);
    if (h.job_id() == job && static_cast<std::size_t>(h.held_size()) < kMaxUnits) *h.add_held() = unit;
  };
  if (current_) add(current_->task.job_id(), current_->task.unit());
  if (held_) {
    for (const wire::Unit& unit : held_->units) add(held_->job, unit);
  }
  for (const Outgoing& outgoing : outgoing_) {
    for (const wire::Unit& unit : outgoing.manifest.units()) add(outgoing.manifest.job_id(), unit);
  }
  std::sort(h.mutable_held()->begin(), h.mutable_held()->end(),
            [](const wire::Unit& a, const wire::Unit& b) { return a.first_sub_pass() < b.first_sub_pass(); });
  h.set_rays(rays_);
  h.set_photon_paths(photon_paths_);
  h.set_sub_passes(sub_passes_);
  h.set_trace_seconds(trace_seconds_);
  h.set_cache_bytes(blobs_.bytes());
  h.set_resident_bytes(resident_bytes());
  last_heartbeat_ = clock_.now();
  send(message);
}

void Session::want_work() {
  if (current_ || fetching_ || draining_ || told_to_idle_ || !welcomed_ || finished_ || clock_.now() < paused_until_)
    return;
  fetching_ = true;
  // With sums in hand that could go at once, only a task that is there already is of use.
  port_.fetch_task(held_ && outgoing_.empty() ? 0.0 : kFetchSeconds);
}

void Session::on_no_task() {
  fetching_ = false;
  // Nothing more of this round is to be had: the coordinator may be waiting for what is here.
  flush();
  end_if_drained();
  want_work();
}

bool Session::fits_held(const wire::Task& task) const {
  if (!held_) return true;
  if (task.kind() != wire::Task::SUB_PASSES || held_->job != task.job_id() || held_->run != task.run() ||
      held_->round_begin != task.round_begin()) {
    return false;
  }
  // A coordinator that was restarted may cut otherwise: no sub-pass may be twice in a sum.
  const wire::Unit& unit = task.unit();
  return held_->units.size() < kMaxUnits &&
         std::none_of(held_->units.begin(), held_->units.end(), [&](const wire::Unit& u) {
           return u.first_sub_pass() < unit.first_sub_pass() + unit.sub_passes() &&
                  unit.first_sub_pass() < u.first_sub_pass() + u.sub_passes();
         });
}

bool Session::is_mine_already(const wire::Task& task, std::uint64_t handle) {
  const auto same = [&](const std::string& job, const wire::Unit& unit) {
    return job == task.job_id() && unit.first_sub_pass() == task.unit().first_sub_pass() &&
           unit.sub_passes() == task.unit().sub_passes();
  };
  if (held_ &&
      std::any_of(held_->units.begin(), held_->units.end(), [&](const auto& u) { return same(held_->job, u); })) {
    held_->handles.push_back(handle);
    return true;
  }
  for (Outgoing& outgoing : outgoing_) {
    const wire::ResultManifest& m = outgoing.manifest;
    if (m.kind() != task.kind()) continue;
    if (std::none_of(m.units().begin(), m.units().end(), [&](const auto& u) { return same(m.job_id(), u); })) continue;
    outgoing.handles.push_back(handle);
    return true;
  }
  return false;
}

void Session::on_task(const Delivery& delivery) {
  fetching_ = false;
  auto task = parse_task(delivery.bytes);
  if (!task || task->build_id() != options_.build_id) {
    log_.error("task refused", {{"why", task ? "it is for build " + task->build_id() : task.error().message}});
    if (task) {
      port_.give_back(delivery.handle);
    } else {
      port_.acknowledge(delivery.handle);
    }
    return want_work();
  }
  if (draining_ || told_to_idle_ || finished_ || current_) return port_.give_back(delivery.handle);
  // The engine hands a task out again when this process stood still for longer than AckWait.
  if (const auto ended = ended_runs_.find(task->job_id()); ended != ended_runs_.end() && task->run() <= ended->second) {
    port_.acknowledge(delivery.handle);
    return want_work();
  }
  if (is_mine_already(*task, delivery.handle)) return want_work();
  current_ = Current{std::move(*task), {delivery.handle}};
  advance();
  send_heartbeat();
}

void Session::advance() {
  if (!current_ || current_->working || finished_) return;
  // Sums of another round must be on their way before this unit's can be gathered.
  if (!fits_held(current_->task) && !flush()) return;
  const auto bundle = have_bundle(current_->task);
  if (!bundle)
    return bundle.error().kind == ErrorKind::kInternal ? hand_back_current(bundle.error())
                                                       : fail_current(bundle.error(), true);
  if (!*bundle) return;
  const wire::Task& task = current_->task;
  if (task.has_state() && task.state().bytes() > 0) {
    if (state_hash_ != sha256_hex_of_bytes(task.state().sha256()) && !have(id_of(task.state()))) return;
    if (auto loaded = load_state(task); !loaded) return hand_back_current(loaded.error());
  }
  begin_work();
}

void Session::begin_work() {
  const wire::Task& task = current_->task;
  Work work;
  work.bundle = sha256_hex_of_bytes(task.bundle().sha256());
  work.spec = bundles_.at(work.bundle);
  if (task.kind() == wire::Task::PREPARE) {
    work.kind = Work::Kind::kPrepare;
  } else {
    if (!held_) {
      held_ = Held{task.job_id(), task.run(), task.round_begin(), {}, {}, {}, 0.0, clock_.now()};
      held_->sums =
          std::make_shared<Statistics>(static_cast<int>(task.width()), static_cast<int>(task.height()), false);
    }
    work.first_sub_pass = task.unit().first_sub_pass();
    work.sub_passes = task.unit().sub_passes();
    static const auto kNoRadii = std::make_shared<const std::vector<ProgressivePixel>>();
    work.state = task.state().bytes() > 0 ? state_radii_ : kNoRadii;
    work.sums = held_->sums;
  }
  current_->working = true;
  executor_.start(std::move(work));
}

void Session::on_done(WorkDone done) {
  if (!current_) return;
  trace_seconds_ += done.seconds;
  current_->working = false;
  if (!done.status || current_->dropped) {
    // What a failed or unwanted unit has added cannot be told from the rest: the whole sum goes.
    if (current_->task.kind() == wire::Task::SUB_PASSES && held_) {
      if (!current_->dropped) {
        for (const std::uint64_t handle : held_->handles) port_.give_back(handle);
      }
      held_.reset();
    }
    if (done.status) {
      acknowledge(current_->handles);
      current_.reset();
    } else {
      fail_current(done.status.error(), done.status.error().kind != ErrorKind::kInternal);
    }
  } else if (done.prepared) {
    send_prepared(*done.prepared);
  } else {
    held_->trace_seconds += done.seconds;
    keep_units();
    if (clock_.now() - held_->since >= hold_seconds()) flush();
  }
  send_heartbeat();
  if (draining_ || told_to_idle_) flush();
  end_if_drained();
  want_work();
}

void Session::keep_units() {
  held_->units.push_back(current_->task.unit());
  held_->handles.insert(held_->handles.end(), current_->handles.begin(), current_->handles.end());
  sub_passes_ += current_->task.unit().sub_passes();
  current_.reset();
}

void Session::fail_current(const Error& error, bool permanent) {
  log_.error("unit failed", {{"job", current_->task.job_id()}, {"why", error.message}});
  wire::FromWorker message;
  wire::TaskFailed& failed = *message.mutable_failed();
  failed.set_job_id(current_->task.job_id());
  failed.set_kind(current_->task.kind());
  *failed.mutable_unit() = current_->task.unit();
  failed.set_error_kind(static_cast<std::uint32_t>(error.kind));
  failed.set_message(as_in_bundle(error.message, current_->task).substr(0, kMaxTextBytes));
  failed.set_permanent(permanent);
  send(message);
  acknowledge(current_->handles);
  current_.reset();
  want_work();
}

void Session::acknowledge(const std::vector<std::uint64_t>& handles) {
  for (const std::uint64_t handle : handles) port_.acknowledge(handle);
}

void Session::on_welcome(const wire::Welcome& welcome) {
  if (!welcome.accepted()) {
    fatal_ = Error{ErrorKind::kUsage, fmt::format("the coordinator refuses this worker: {}", welcome.reason())};
    return abandon();
  }
  if (welcome.ack_wait_seconds() > 0) ack_wait_ = welcome.ack_wait_seconds();
  told_to_idle_ = welcome.idle();
  if (!std::exchange(welcomed_, true)) log_.info("joined the farm", {{"worker", options_.name}});
  if (told_to_idle_ && !current_) flush();
  want_work();
}

void Session::on_job_ended(const wire::JobEnded& ended) {
  const std::string& job = ended.job_id();
  const std::uint64_t run = ended.run();
  ended_runs_[job] = std::max(ended_runs_[job], run);
  if (ended_runs_.size() > kRememberedJobs) {
    const auto first = ended_runs_.begin();
    ended_runs_.erase(first->first == job ? std::next(first) : first);
  }
  std::erase_if(outgoing_, [&](const Outgoing& outgoing) {
    if (outgoing.manifest.job_id() != job || outgoing.run > run) return false;
    acknowledge(outgoing.handles);
    return true;
  });
  announce_first();
  const bool have_it = current_ && current_->task.job_id() == job && current_->task.run() <= run;
  const bool working_on_it = have_it && current_->working;
  if (held_ && held_->job == job && held_->run <= run) {
    acknowledge(held_->handles);
    held_->handles.clear();
    held_->units.clear();
    if (!working_on_it) held_.reset();
  }
  if (working_on_it) {
    current_->dropped = true;
  } else if (have_it) {
    acknowledge(current_->handles);
    current_.reset();
    fetch_.reset();
  }
  advance();
  want_work();
}

void Session::on_message(std::string_view bytes) {
  const auto message = parse_to_worker(bytes);
  if (!message) return log_.warning("malformed message from the coordinator", {{"why", message.error().message}});
  switch (message->body_case()) {
    case wire::ToWorker::kBlobPart:
      return on_blob_part(message->blob_part());
    case wire::ToWorker::kResultReply:
      return on_reply(message->result_reply());
    case wire::ToWorker::kWelcome:
      return on_welcome(message->welcome());
    case wire::ToWorker::kJobEnded:
      return on_job_ended(message->job_ended());
    default:
      return;
  }
}

void Session::tick() {
  if (finished_) return;
  const double now = clock_.now();
  if (now - last_in_progress_ >= ack_wait_ / 3) {
    last_in_progress_ = now;
    const auto hold = [&](const std::vector<std::uint64_t>& handles) {
      for (const std::uint64_t handle : handles) port_.in_progress(handle);
    };
    if (current_) hold(current_->handles);
    if (held_) hold(held_->handles);
    for (const Outgoing& outgoing : outgoing_) hold(outgoing.handles);
  }
  if (!outgoing_.empty() && now - outgoing_.front().last_word >= kRepeatSeconds) announce_first();
  if (fetch_ && now - fetch_->asked >= kRepeatSeconds) ask_for_blob();
  if (now - last_heartbeat_ >= kHeartbeatSeconds) send_heartbeat();
  if (paused_until_ > 0 && now >= paused_until_) {
    paused_until_ = 0;
    want_work();
  }
  if (draining_ && now - drain_since_ > kDrainSeconds) abandon();
}

void Session::drain() {
  if (std::exchange(draining_, true)) return;
  drain_since_ = clock_.now();
  if (current_ && !current_->working) {
    for (const std::uint64_t handle : current_->handles) port_.give_back(handle);
    current_.reset();
    fetch_.reset();
  }
  send_heartbeat();
  if (!current_) flush();
  end_if_drained();
}

void Session::end_if_drained() {
  if (draining_ && !current_ && !held_ && outgoing_.empty()) finished_ = true;
}

void Session::abandon() {
  const auto give_back = [&](const std::vector<std::uint64_t>& handles) {
    for (const std::uint64_t handle : handles) port_.give_back(handle);
  };
  if (current_) give_back(current_->handles);
  if (held_) give_back(held_->handles);
  for (const Outgoing& outgoing : outgoing_) give_back(outgoing.handles);
  if (current_ && !current_->working) current_.reset();
  held_.reset();
  outgoing_.clear();
  finished_ = true;
}

}  // namespace pf
