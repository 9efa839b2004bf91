#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/result.h"
#include "common/wire/blob_store.h"
#include "common/wire/ports.h"
#include "coordinator/farm_job.h"
#include "coordinator/job_log.h"
#include "coordinator/job_service.h"
#include "coordinator/metrics.h"
#include "coordinator/worker_registry.h"

namespace pf {

struct FarmOptions {
  std::filesystem::path state;            ///< jobs/, blobs/ lie in it
  std::string build_id;
  double ack_wait_seconds = 30;
  double worker_silence_seconds = 10;     ///< after which a worker counts as lost
  std::size_t tasks_per_worker = 2;       ///< kept in the work queue
  std::uint64_t incarnation = 1;          ///< differs between processes: goes into the ids of tasks
  Metrics* metrics = nullptr;             ///< where work is counted; nullptr: nobody asks
};

/// The coordinator without its surroundings: told what came in and what time it is, it answers through the port. All calls
/// come from one thread.
class Farm {
 public:
  Farm(FarmOptions options, CoordinatorPort& port, BlobStore& blobs, const Clock& clock,
       std::function<std::int64_t()> unix_ms, const Log& log);

  /// Takes up the jobs of the state folder. Errors only when the folder cannot be used at all; a broken job is reported and left
  /// as it is.
  [[nodiscard]] Result<void> restore();

  /// A FromWorker; `sender` is the name that the engine vouches for.
  void on_message(const std::string& sender, std::string_view bytes);
  /// The engine is there (again).
  void on_connected();
  void tick();
  void shut_down();

  [[nodiscard]] Result<JobView> submit(const Submission& submission);
  [[nodiscard]] std::vector<JobView> list() const;
  [[nodiscard]] Result<JobView> show(const std::string& id) const;
  [[nodiscard]] Result<JobView> cancel(const std::string& id);
  [[nodiscard]] Result<std::filesystem::path> artifact(const std::string& id, Artifact kind) const;
  [[nodiscard]] Result<std::string> preview_png(const std::string& id) const;
  [[nodiscard]] Result<std::vector<LogEntry>> logs(const std::string& id, std::uint64_t after) const;
  [[nodiscard]] std::vector<WorkerView> workers() const { return registry_.views(clock_.now()); }
  /// Grows with everything that a watcher might see.
  [[nodiscard]] std::uint64_t version() const { return version_; }

 private:
  void pump();
  [[nodiscard]] bool publish(FarmJob& job, const wire::Task& task);
  void on_heartbeat(const std::string& worker, std::uint64_t incarnation, const wire::Heartbeat& heartbeat);
  void on_blob_request(const std::string& worker, const wire::BlobRequest& request);
  void give(const std::string& worker, Answer answer);
  void accuse(const std::string& worker, const std::string& what);
  void send(const std::string& worker, const wire::ToWorker& message);
  void note_ended();
  [[nodiscard]] FarmJob* find(const std::string& id) const;
  [[nodiscard]] JobSurroundings surroundings();
  [[nodiscard]] std::string new_id(const std::string& name) const;

  FarmOptions options_;
  CoordinatorPort& port_;
  BlobStore& blobs_;
  const Clock& clock_;
  std::function<std::int64_t()> unix_ms_;
  const Log& log_;
  Metrics uncounted_;                      ///< when options name none
  Metrics& metrics_;
  WorkerRegistry registry_;
  struct Entry {
    std::unique_ptr<FarmJob> job;
    JobLog log;
    double share = 0;         ///< seconds of work given, by weight: the least has its turn [stride scheduling, Waldspurger 1994]
    bool end_announced = false;
  };
  std::map<std::string, Entry> jobs_;
  bool purged_ = false;       ///< tasks of an earlier process are gone from the queue
  bool connected_ = false;
  double next_publish_ = 0;   ///< after a failure
  std::uint64_t version_ = 1;
};

}  // namespace pf
