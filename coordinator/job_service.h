#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/wire/blob_store.h"

namespace pf {

/// Where a job stands. Queued -> preparing (a worker loads the scene) -> running -> finishing (the image is written) -> done;
/// failed and cancelled end it too. Waiting: running, but held up by something that `message` names (a full disk).
enum class JobState { kQueued, kPreparing, kRunning, kWaiting, kFinishing, kDone, kFailed, kCancelled };
[[nodiscard]] std::string_view to_string(JobState state);
[[nodiscard]] constexpr bool has_ended(JobState s) {
  return s == JobState::kDone || s == JobState::kFailed || s == JobState::kCancelled;
}

/// A job as users see it.
struct JobView {
  std::string id;                       ///< [a-z0-9-]{1,64}, made by the coordinator
  std::string name;                     ///< job.name
  JobState state = JobState::kQueued;
  std::string message;                  ///< why it waits or failed; warnings are in `warnings`
  int priority = 50;
  std::string algorithm;                ///< after `auto` was decided
  int width = 0, height = 0;
  std::uint64_t passes_done = 0;
  std::uint64_t passes_wanted = 0;      ///< stop.passes; 0: no bound
  double stop_seconds = 0, stop_error = 0;
  std::uint64_t rounds = 0;
  std::optional<double> estimated_error;
  double seconds = 0;                   ///< since it began to run
  std::optional<double> seconds_left;   ///< estimate from the rate so far
  std::uint64_t rays = 0, photon_paths = 0;
  double rays_per_second = 0, passes_per_second = 0;
  int workers = 0;                      ///< that hold its units now
  std::uint64_t units_done = 0, units_repeated = 0;   ///< attempts beyond a unit's first
  std::uint64_t bytes_received = 0;
  double merge_seconds = 0;
  std::string image_hash;               ///< when done
  std::string scene_hash, spec_hash;
  std::vector<std::string> warnings;
  std::int64_t submitted_unix_ms = 0, started_unix_ms = 0, ended_unix_ms = 0;   ///< 0: not yet
};

struct WorkerView {
  std::string name;
  std::string host;
  std::uint64_t process = 0;
  std::string state;                    ///< idle, loading, tracing, sending, draining, lost, quarantined
  std::string message;                  ///< why it was quarantined
  std::string job_id;
  int units_held = 0;
  std::uint64_t rays = 0, sub_passes = 0;
  double seconds_since_heard = 0;
};

struct LogEntry {
  std::uint64_t number = 0;             ///< ascending within a job
  std::int64_t unix_ms = 0;
  std::string level, source, text;      ///< source: coordinator or a worker's name
};

struct Submission {
  std::string spec_json;                            ///< the job model as JSON
  std::vector<std::pair<std::string, BlobId>> files;  ///< of the bundle; all blobs are in the store already
  std::string idempotency_key;                      ///< the same key again returns the first job; may be empty
};

enum class Artifact { kExr, kPng, kJson, kCheckpoint };

/// What the HTTP API needs. Calls come from any thread.
class JobService {
 public:
  virtual ~JobService() = default;
  /// Errors: kInvalidSpec with the spec's place; kInvalidInput for missing blobs or bad paths.
  [[nodiscard]] virtual Result<JobView> submit(const Submission& submission) = 0;
  [[nodiscard]] virtual std::vector<JobView> list() = 0;
  /// Errors of all below: kUsage when no job has this id.
  [[nodiscard]] virtual Result<JobView> show(const std::string& id) = 0;
  /// Ends a job; the image so far stays and can be fetched. A job that has ended stays as it is.
  [[nodiscard]] virtual Result<JobView> cancel(const std::string& id) = 0;
  /// Where the file lies; it does not change afterwards (it may be replaced as a whole). Errors: kUnavailable while there is
  /// none yet.
  [[nodiscard]] virtual Result<std::filesystem::path> artifact(const std::string& id, Artifact kind) = 0;
  /// The image so far. Errors: kUnavailable before the first sub-pass.
  [[nodiscard]] virtual Result<std::string> preview_png(const std::string& id) = 0;
  /// Entries after `after`, at most 1000.
  [[nodiscard]] virtual Result<std::vector<LogEntry>> logs(const std::string& id, std::uint64_t after) = 0;
  [[nodiscard]] virtual std::vector<WorkerView> workers() = 0;
  /// Blocks until any job's view has changed since `version`, or `seconds` went by; returns the version now. For watching.
  [[nodiscard]] virtual std::uint64_t wait_for_change(std::uint64_t version, double seconds) = 0;
};

}  // namespace pf
