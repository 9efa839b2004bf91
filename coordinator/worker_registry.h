#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/wire/messages.h"
#include "coordinator/job_service.h"

namespace pf {

/// The workers that have been heard, and those that are not trusted any more. A worker is a name; a restarted one is
/// the same worker in another incarnation.
class WorkerRegistry {
 public:
  struct Worker {
    std::uint64_t incarnation = 0;
    wire::Heartbeat heartbeat;
    double heard = 0;                   ///< when
    double idle_since = 0;              ///< meaningful while it is idle
    std::string quarantined;            ///< why; empty: trusted
    int faults = 0;                     ///< malformed messages so far
    std::optional<WorkerVerb> steered;  ///< drained or disabled ...
    std::string steered_by;             ///< ... by whom
    bool lost = false;                  ///< said so by newly_lost()
  };

  /// `silence`: seconds without a word after which a worker counts as lost.
  explicit WorkerRegistry(double silence) : silence_(silence) {}

  Worker& heard(const std::string& name, std::uint64_t incarnation, const wire::Heartbeat& heartbeat, double now);
  /// From then on nothing that the worker says counts. The name stays barred while the coordinator runs: the same
  /// program on the same host would err again.
  void quarantine(const std::string& name, const std::string& reason);
  [[nodiscard]] bool is_quarantined(const std::string& name) const;
  /// False when the name is not known. Enabling also ends a quarantine.
  bool steer(const std::string& name, WorkerVerb verb, const std::string& by);
  /// The same of one that has not been heard yet.
  void remember(const std::string& name, WorkerVerb verb, const std::string& by);
  /// Drained or disabled: it takes no more work.
  [[nodiscard]] bool is_idled(const std::string& name) const;
  [[nodiscard]] bool is_disabled(const std::string& name) const;
  /// A malformed message. True when that was one too many: the worker is in quarantine now.
  bool fault(const std::string& name, const std::string& what);

  /// Workers that have not been heard for too long; each is named once until it is heard again.
  [[nodiscard]] std::vector<std::string> newly_lost(double now);
  [[nodiscard]] std::size_t live(double now) const;
  /// True when a live worker has had nothing to do since `since` or longer.
  [[nodiscard]] bool any_idle_since(double since, double now) const;
  [[nodiscard]] std::vector<WorkerView> views(double now) const;
  /// Of a known one.
  [[nodiscard]] WorkerView view(const std::string& name, double now) const;
  [[nodiscard]] const std::map<std::string, Worker>& all() const { return workers_; }

 private:
  /// Takes work, as far as is known.
  [[nodiscard]] bool works(const Worker& worker, double now) const;
  std::map<std::string, Worker> workers_;
  double silence_;
};

}  // namespace pf
