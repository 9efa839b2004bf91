#include "coordinator/worker_registry.h"

#include <algorithm>
#include <utility>

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

std::size_t WorkerRegistry::live(double now) const {
  return static_cast<std::size_t>(std::count_if(workers_.begin(), workers_.end(), [&](const auto& entry) {
    return entry.second.quarantined.empty() && now - entry.second.heard < silence_;
  }));
}

bool WorkerRegistry::any_idle_since(double since, double now) const {
  return std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
    const Worker& w = entry.second;
    return w.quarantined.empty() && now - w.heard < silence_ && w.heartbeat.activity() == wire::Heartbeat::IDLE &&
           w.idle_since <= since;
  });
}

std::vector<WorkerView> WorkerRegistry::views(double now) const {
  std::vector<WorkerView> views;
  for (const auto& [name, w] : workers_) {
    WorkerView view;
    view.name = name;
    view.host = w.heartbeat.host();
    view.process = w.heartbeat.process();
    view.state = !w.quarantined.empty() ? "quarantined" : now - w.heard >= silence_ ? "lost" : name_of(w.heartbeat.activity());
    view.message = w.quarantined;
    view.job_id = w.heartbeat.job_id();
    view.units_held = w.heartbeat.held_size();
    view.rays = w.heartbeat.rays();
    view.sub_passes = w.heartbeat.sub_passes();
    view.seconds_since_heard = now - w.heard;
    views.push_back(std::move(view));
  }
  return views;
}

}  // namespace pf
