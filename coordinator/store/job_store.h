#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/wire/blob_store.h"
#include "coordinator/store/job_record.h"
#include "coordinator/store/sqlite.h"

namespace pf {

/// A change of a job's state, or what was refused to be one; see job_state.h.
struct Transition {
  std::int64_t unix_ms = 0;
  JobEvent event = JobEvent::kPrepare;
  JobState from = JobState::kQueued, to = JobState::kQueued;
  std::string by;  ///< name of a token; empty: the farm itself
};

/// What outlives the coordinator's process beside films, images and logs: `farm.sqlite` in the state folder. Each call
/// is one transaction, on the disk when it returns. Errors: those of Database.
class JobStore {
 public:
  static constexpr std::string_view kFileName = "farm.sqlite";

  /// Makes or migrates it.
  [[nodiscard]] static Result<JobStore> open(const std::filesystem::path& file);

  /// All jobs by number; those whose record makes no sense are in `broken` with the reason.
  struct Loaded {
    std::vector<JobRecord> records;
    std::vector<std::pair<std::string, std::string>> broken;  ///< id, why
  };
  [[nodiscard]] Result<Loaded> load() const;
  [[nodiscard]] Result<bool> has(const std::string& id) const;
  /// Number of the next job.
  [[nodiscard]] Result<std::uint64_t> next_number() const;
  [[nodiscard]] Result<std::optional<std::string>> job_with_key(const std::string& idempotency_key) const;

  /// A new job and the blobs that it needs. Sets the record's number.
  [[nodiscard]] Result<void> insert(JobRecord& record, std::span<const BlobId> blobs);
  [[nodiscard]] Result<void> save(const JobRecord& record, std::span<const Transition> transitions);
  /// What goes with a checkpoint of the film: written before it, because what the film does not hold can be told and
  /// taken off.
  [[nodiscard]] Result<void> checkpoint(const JobRecord& record, std::span<const CountedResult> results,
                                        const std::vector<ConvergencePoint>& points);
  /// Forgets results from this number on; a job that begins anew has none (1).
  [[nodiscard]] Result<void> forget_results(std::uint64_t job, std::uint64_t from);
  [[nodiscard]] Result<void> remove(std::uint64_t job);

  /// Counted units whose first sub-pass is `from` or later, ascending.
  [[nodiscard]] Result<std::vector<UnitView>> units(std::uint64_t job, std::uint64_t from, std::size_t most) const;
  struct Results {
    std::uint64_t count = 0;
    std::set<std::string> workers;  ///< that they came from
  };
  [[nodiscard]] Result<Results> results(std::uint64_t job) const;
  [[nodiscard]] Result<std::vector<ConvergencePoint>> convergence(std::uint64_t job) const;
  [[nodiscard]] Result<std::vector<Transition>> transitions(std::uint64_t job) const;

  /// Blobs that this job alone needs.
  [[nodiscard]] Result<std::vector<BlobId>> own_blobs(std::uint64_t job) const;
  [[nodiscard]] Result<void> release_blobs(std::uint64_t job);
  /// Every blob that a job needs, by hash.
  [[nodiscard]] Result<std::map<std::string, std::uint64_t>> all_blobs() const;

  struct SteeredWorker {
    std::string name, by;
    WorkerVerb verb = WorkerVerb::kDrain;
  };
  [[nodiscard]] Result<std::vector<SteeredWorker>> workers() const;
  /// kEnable forgets it.
  [[nodiscard]] Result<void> save_worker(const SteeredWorker& worker);

  [[nodiscard]] const Database& database() const { return database_; }

 private:
  explicit JobStore(Database database) : database_(std::move(database)) {}
  [[nodiscard]] Result<void> write(const JobRecord& record) const;
  Database database_;
};

[[nodiscard]] std::string_view to_string(WorkerVerb verb);

}  // namespace pf
