#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/result.h"
#include "common/wire/blob_store.h"
#include "common/wire/ports.h"
#include "coordinator/config.h"
#include "coordinator/farm_job.h"
#include "coordinator/job_log.h"
#include "coordinator/job_service.h"
#include "coordinator/metrics.h"
#include "coordinator/retention.h"
#include "coordinator/store/job_store.h"
#include "coordinator/worker_registry.h"

namespace pf {

struct FarmOptions {
  std::filesystem::path state;  ///< jobs/, blobs/ lie in it
  std::string build_id;
  double ack_wait_seconds = 30;
  double worker_silence_seconds = 10;  ///< after which a worker counts as lost
  std::size_t tasks_per_worker = 2;    ///< kept in the work queue
  std::uint64_t incarnation = 1;       ///< differs between processes: goes into the ids of tasks
  Metrics* metrics = nullptr;          ///< where work is counted; nullptr: nobody asks
  RetentionPolicy retention;
  std::uint64_t jobs_per_token = CoordinatorConfig::Limits().jobs_per_token;
};

/// The coordinator without its surroundings: told what came in and what time it is, it answers through the port. All
/// calls come from one thread.
class Farm {
 public:
  Farm(FarmOptions options, CoordinatorPort& port, BlobStore& blobs, const Clock& clock,
       std::function<std::int64_t()> unix_ms, const Log& log);

  /// Takes up the jobs of the state folder; everything below needs it to have succeeded. Errors only when the folder or
  /// its database cannot be used at all; a broken job is reported and left as it is.
  [[nodiscard]] Result<void> restore();

  /// A FromWorker; `sender` is the name that the engine vouches for.
  void on_message(const std::string& sender, std::string_view bytes);
  /// The engine is there (again).
  void on_connected();
  void tick();
  void shut_down();

  [[nodiscard]] Result<JobView> submit(const Submission& submission);
  [[nodiscard]] Result<Validation> validate(const Submission& submission) const;
  [[nodiscard]] Result<JobList> list(const JobFilter& filter) const;
  [[nodiscard]] std::vector<JobView> list() const;
  [[nodiscard]] Result<JobView> show(const std::string& id) const;
  [[nodiscard]] Result<JobView> act(const std::string& id, JobEvent verb, const std::string& by);
  [[nodiscard]] Result<JobView> extend(const std::string& id, const StopChange& stops, const std::string& by);
  [[nodiscard]] Result<JobView> change(const std::string& id, const JobChange& change, const std::string& by);
  [[nodiscard]] Result<void> remove(const std::string& id, const std::string& by);
  [[nodiscard]] Result<UnitPage> units(const std::string& id, std::optional<std::uint64_t> after) const;
  [[nodiscard]] Result<std::vector<ConvergencePoint>> convergence(const std::string& id) const;
  [[nodiscard]] Result<Estimate> estimate(const std::string& id, const EstimateRequest& request) const;
  [[nodiscard]] Result<std::filesystem::path> artifact(const std::string& id, Artifact kind) const;
  [[nodiscard]] Result<std::string> preview_png(const std::string& id) const;
  [[nodiscard]] Result<LayerList> layers(const std::string& id) const;
  [[nodiscard]] Result<LayerPixels> pixels(const std::string& id, const std::string& layer, int max_width) const;
  [[nodiscard]] Result<std::vector<LogEntry>> logs(const std::string& id, std::uint64_t after) const;
  [[nodiscard]] std::vector<WorkerView> workers() const { return registry_.views(clock_.now()); }
  [[nodiscard]] Result<WorkerView> steer(const std::string& worker, WorkerVerb verb, const std::string& by);
  /// Grows with everything that a watcher might see.
  [[nodiscard]] std::uint64_t version() const { return version_; }

 private:
  /// Jobs of before there was a database.
  [[nodiscard]] Result<void> import_jobs();
  /// Removes the blobs that this job alone needs.
  void free_blobs(std::uint64_t job);
  void look_at_retention();
  void expire_files();
  /// Blobs that no job needs, a day after they came.
  void sweep_blobs();
  void pump();
  /// Whose turn it is among those that may have one; null: nobody's.
  [[nodiscard]] FarmJob* next_job(std::size_t window, const std::vector<FarmJob*>& without_work);
  /// The queued job that may begin now; null while there is none, or enough films are in memory.
  [[nodiscard]] const FarmJob* next_to_begin() const;
  void welcome(const std::string& worker);
  /// After a user's word: tells workers and watchers.
  [[nodiscard]] Result<JobView> changed(FarmJob& job, Result<void> done);
  [[nodiscard]] bool publish(FarmJob& job, const wire::Task& task);
  void on_heartbeat(const std::string& worker, std::uint64_t incarnation, const wire::Heartbeat& heartbeat);
  void on_blob_request(const std::string& worker, const wire::BlobRequest& request);
  void give(const std::string& worker, Answer answer);
  void accuse(const std::string& worker, const std::string& what);
  void send(const std::string& worker, const wire::ToWorker& message);
  void note_ended();
  /// An error when this token has as many jobs that have not ended as it may have.
  [[nodiscard]] Result<void> room_for_job(const std::string& token) const;
  [[nodiscard]] FarmJob* find(const std::string& id) const;
  /// The film of a job that has an image.
  [[nodiscard]] Result<const Film*> film_of(const std::string& id) const;
  [[nodiscard]] JobSurroundings surroundings();
  /// Of those that run now: a job that comes starts level with it, and neither waits for nor makes up what was before.
  [[nodiscard]] double least_share() const;
  [[nodiscard]] Result<std::string> new_id(const std::string& name) const;

  FarmOptions options_;
  CoordinatorPort& port_;
  BlobStore& blobs_;
  const Clock& clock_;
  std::function<std::int64_t()> unix_ms_;
  const Log& log_;
  Metrics uncounted_;  ///< when options name none
  Metrics& metrics_;
  WorkerRegistry registry_;
  std::optional<JobStore> store_;  ///< there since restore()
  struct Entry {
    std::unique_ptr<FarmJob> job;
    JobLog log;
    double share =
        0;  ///< seconds of work given, by weight: the least has its turn [stride scheduling, Waldspurger 1994]
    std::uint64_t runs_announced = 0;  ///< that are over, and workers were told so
  };
  std::map<std::string, Entry> jobs_;
  bool purged_ = false;  ///< tasks of an earlier process are gone from the queue
  bool connected_ = false;
  double next_publish_ = 0;  ///< after a failure
  double next_retention_ = 0, next_sweep_ = 0;
  std::uint64_t version_ = 1;
};

}  // namespace pf
