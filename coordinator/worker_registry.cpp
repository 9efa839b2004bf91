#include "coordinator/worker_registry.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "coordinator/store/job_store.h"

namespace pf {
namespace {

/// One broken message may be the network's fault; a third is the worker's.
constexpr int kMaxFaults = 3;

const char* name_of(wire::Heartbeat::Activity activity) {
  switch (activity) {
    case wire::Heartbeat::LOADING:
      return "loading";
    case wire::Heartbeat::TRACING:
      return "tracing";
    case wire::Heartbeat::SENDING:
      return "sending";
    case wire::Heartbeat::DRAINING:
      return "draining";
    default:
      return "idle";
  }
}

}  // namespace

WorkerRegistry::Worker& WorkerRegistry::heard(const std::string& name, std::uint64_t incarnation,
                                              const wire::Heartbeat& heartbeat, double now) {
  Worker& worker = workers_[name];
  const bool was_idle = worker.incarnation == incarnation && worker.heartbeat.activity() == wire::Heartbeat::IDLE;
  if (!was_idle) worker.idle_since = now;
  worker.incarnation = incarnation;
  worker.heartbeat = heartbeat;
  worker.heard = now;
  worker.lost = false;
  return worker;
}

void WorkerRegistry::quarantine(const std::string& name, const std::string& reason) {
  Worker& worker = workers_[name];
  if (worker.quarantined.empty()) worker.quarantined = reason;
}

bool WorkerRegistry::is_quarantined(const std::string& name) const {
  const auto it = workers_.find(name);
  return it != workers_.end() && !it->second.quarantined.empty();
}

bool WorkerRegistry::fault(const std::string& name, const std::string& what) {
  Worker& worker = workers_[name];
  if (++worker.faults < kMaxFaults) return false;
  quarantine(name, what);
  return true;
}

std::vector<std::string> WorkerRegistry::newly_lost(double now) {
  std::vector<std::string> names;
  for (auto& [name, worker] : workers_) {
    if (now - worker.heard >= silence_ && !std::exchange(worker.lost, true)) names.push_back(name);
  }
  return names;
}

bool WorkerRegistry::steer(const std::string& name, WorkerVerb verb, const std::string& by) {
  const auto found = workers_.find(name);
  if (found == workers_.end()) return false;
  Worker& worker = found->second;
  worker.steered = verb == WorkerVerb::kEnable ? std::nullopt : std::optional(verb);
  worker.steered_by = by;
  if (verb == WorkerVerb::kEnable) {
    worker.quarantined.clear();
    worker.faults = 0;
  }
  return true;
}

void WorkerRegistry::remember(const std::string& name, WorkerVerb verb, const std::string& by) {
  Worker& worker = workers_[name];
  worker.heard = -std::numeric_limits<double>::infinity();
  worker.lost = true;
  worker.steered = verb;
  worker.steered_by = by;
}

bool WorkerRegistry::is_idled(const std::string& name) const {
  const auto it = workers_.find(name);
  return it != workers_.end() && it->second.steered.has_value();
}

bool WorkerRegistry::is_disabled(const std::string& name) const {
  const auto it = workers_.find(name);
  return it != workers_.end() && it->second.steered == WorkerVerb::kDisable;
}

bool WorkerRegistry::works(const Worker& worker, double now) const {
  return worker.quarantined.empty() && !worker.steered && now - worker.heard < silence_;
}

std::size_t WorkerRegistry::live(double now) const {
  return static_cast<std::size_t>(
      std::count_if(workers_.begin(), workers_.end(), [&](const auto& entry) { return works(entry.second, now); }));
}

bool WorkerRegistry::any_idle_since(double since, double now) const {
  return std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
    const Worker& w = entry.second;
    return works(w, now) && w.heartbeat.activity() == wire::Heartbeat::IDLE && w.idle_since <= since;
  });
}

std::vector<WorkerView> WorkerRegistry::views(double now) const {
  std::vector<WorkerView> views;
  for (const auto& [name, worker] : workers_) views.push_back(view(name, now));
  return views;
}

WorkerView WorkerRegistry::view(const std::string& name, double now) const {
  const Worker& w = workers_.at(name);
  WorkerView view;
  view.name = name;
  view.host = w.heartbeat.host();
  view.process = w.heartbeat.process();
  const bool has_work = w.heartbeat.held_size() > 0;
  view.state = !w.quarantined.empty()              ? "quarantined"
               : now - w.heard >= silence_         ? "lost"
               : w.steered == WorkerVerb::kDisable ? "disabled"
               : w.steered && has_work             ? "draining"
               : w.steered                         ? "drained"
                                                   : name_of(w.heartbeat.activity());
  view.message = w.quarantined;
  if (view.message.empty() && w.steered)
    view.message = std::string(to_string(*w.steered)) + (w.steered_by.empty() ? "" : ", by " + w.steered_by);
  view.job_id = w.heartbeat.job_id();
  view.units_held = w.heartbeat.held_size();
  view.rays = w.heartbeat.rays();
  view.sub_passes = w.heartbeat.sub_passes();
  view.seconds_since_heard = now - w.heard;
  return view;
}

}  // namespace pf
