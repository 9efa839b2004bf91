#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/film/prediction.h"
#include "common/wire/blob_store.h"
#include "coordinator/job_state.h"
#include "coordinator/layer_pixels.h"

namespace pf {

/// A job as users see it.
struct JobView {
  std::string id;    ///< [a-z0-9-]{1,64}, made by the coordinator
  std::string name;  ///< job.name
  JobState state = JobState::kQueued;
  std::string message;  ///< why it waits or failed; warnings are in `warnings`
  int priority = 50;
  int max_workers = 0;                  ///< that may hold its units at a time; 0: no bound
  std::string submitted_by, paused_by;  ///< names of tokens; paused_by is empty unless it is paused
  int extended = 0;                     ///< times that its stops were changed
  std::vector<std::string> expired;     ///< "checkpoint", "results": what the policy of retention has removed
  std::string algorithm;                ///< after `auto` was decided
  int width = 0, height = 0;
  std::uint64_t passes_done = 0;
  std::uint64_t passes_wanted = 0;  ///< stop.passes; 0: no bound
  double stop_seconds = 0, stop_error = 0;
  std::uint64_t rounds = 0;
  std::optional<double> estimated_error;
  double seconds = 0;                  ///< since it began to run
  std::optional<double> seconds_left;  ///< estimate from the rate so far
  std::uint64_t rays = 0, photon_paths = 0;
  double rays_per_second = 0, passes_per_second = 0;
  int workers = 0;                                   ///< that hold its units now
  std::uint64_t units_done = 0, units_repeated = 0;  ///< attempts beyond a unit's first
  std::uint64_t bytes_received = 0;
  double merge_seconds = 0;
  std::string image_hash;  ///< when done
  std::string scene_hash, spec_hash;
  std::vector<std::string> warnings;
  std::int64_t submitted_unix_ms = 0, started_unix_ms = 0, ended_unix_ms = 0;  ///< 0: not yet
};

struct WorkerView {
  std::string name;
  std::string host;
  std::uint64_t process = 0;
  std::string state;    ///< idle, loading, tracing, sending, draining, drained, disabled, lost, quarantined
  std::string message;  ///< why it was quarantined, or who drained or disabled it
  std::string job_id;
  int units_held = 0;
  std::uint64_t rays = 0, sub_passes = 0;
  double seconds_since_heard = 0;
};

struct LogEntry {
  std::uint64_t number = 0;  ///< ascending within a job
  std::int64_t unix_ms = 0;
  std::string level, source, text;  ///< source: coordinator or a worker's name
};

struct Submission {
  std::string spec_json;                              ///< the job model as JSON
  std::vector<std::pair<std::string, BlobId>> files;  ///< of the bundle; all blobs are in the store already
  std::string idempotency_key;                        ///< the same key again returns the first job; may be empty
  std::string submitted_by;                           ///< name of a token
  double pilot_seconds = 0;                           ///< > 0: a pilot, that is the job stopped after so many seconds
};

/// What a job file says, without submitting it.
struct Validation {
  std::string spec_json;  ///< canonical
  std::vector<std::string> warnings;
};

/// Which jobs; empty members are no filters.
struct JobFilter {
  std::optional<JobState> state;
  std::string name;
  std::size_t limit = 1000;  ///< the latest so many
  std::string before;        ///< id: only jobs submitted before this one
};
struct JobList {
  std::vector<JobView> jobs;  ///< by time of submission
  std::string before;         ///< for the filter that goes on with older ones; empty: there are none
};

/// New values of the stops; absent ones stay.
struct StopChange {
  std::optional<std::int64_t> passes;  ///< more than so far; 0: no bound
  std::optional<double> seconds, error;
};
/// What an estimate is to be for; 0: what the job's own stops say.
struct EstimateRequest {
  double passes = 0, error = 0;
};
struct Estimate {
  PilotRender pilot;      ///< what the job has shown
  Prediction prediction;  ///< ranges of nothing but 0: not known
  int workers = 1;        ///< that took part: seconds and bytes are for so many
};
struct JobChange {
  std::optional<int> priority;     ///< 0..100
  std::optional<int> max_workers;  ///< 0: no bound
};

/// A work unit. `part` is the tile [x0, y0, x1, y1) of its first sub-pass, empty when sub-passes cover the whole image.
struct UnitView {
  std::uint64_t first = 0, count = 0;
  std::vector<int> part;
  std::string state;  ///< new, out, done
  std::uint32_t attempts = 0;
  std::string worker;        ///< that has it or did it
  double seconds = 0;        ///< of tracing
  std::uint64_t result = 0;  ///< units of one number were merged before they were sent ...
  std::string sums_hash;     ///< ... and this is the XXH3-128 of their sums (statistics_codec.h)
};
struct UnitPage {
  std::vector<UnitView> units;         ///< ascending by first
  std::optional<std::uint64_t> after;  ///< for the next page; absent: there is none
};

/// How far a job was at some moment.
struct ConvergencePoint {
  double seconds = 0;
  std::uint64_t passes = 0, rounds = 0, rays = 0;
  std::optional<double> estimated_error;
  friend bool operator==(const ConvergencePoint&, const ConvergencePoint&) = default;
};

/// Drain: it finishes what it has and takes no more. Disable: what it has goes to others at once. Enable: as if nothing
/// had been.
enum class WorkerVerb { kDrain, kDisable, kEnable };

enum class Artifact { kExr, kPng, kJson, kCheckpoint };

/// What the HTTP API needs. Calls come from any thread; `by` is the name of the token that asks.
class JobService {
 public:
  virtual ~JobService() = default;
  /// Errors: kInvalidSpec with the spec's place; kInvalidInput for missing blobs or bad paths; kUnavailable when the
  /// token has too many jobs already.
  [[nodiscard]] virtual Result<JobView> submit(const Submission& submission) = 0;
  /// What submit() would say; files may be missing, and are warned of.
  [[nodiscard]] virtual Result<Validation> validate(const Submission& submission) = 0;
  /// Errors: kUsage when `before` names no job.
  [[nodiscard]] virtual Result<JobList> list(const JobFilter& filter) = 0;
  /// Every job; none while the coordinator is shutting down.
  [[nodiscard]] std::vector<JobView> list() {
    JobFilter all;
    all.limit = std::numeric_limits<std::size_t>::max();
    auto listed = list(all);
    return listed ? std::move(listed->jobs) : std::vector<JobView>();
  }
  /// Errors of all below: kUsage when no job has this id; kUnavailable when its state does not permit it.
  [[nodiscard]] virtual Result<JobView> show(const std::string& id) = 0;
  /// kPause, kResume, kRetry, kCancel or kDiscard.
  [[nodiscard]] virtual Result<JobView> act(const std::string& id, JobEvent verb, const std::string& by) = 0;
  /// A job that is done goes on, to the bits of one long run. Errors: kInvalidInput for values; kUnavailable also when
  /// its checkpoint has expired or is of another build.
  [[nodiscard]] virtual Result<JobView> extend(const std::string& id, const StopChange& stops,
                                               const std::string& by) = 0;
  [[nodiscard]] virtual Result<JobView> change(const std::string& id, const JobChange& change,
                                               const std::string& by) = 0;
  /// Removes an ended job and all that only it needs.
  [[nodiscard]] virtual Result<void> remove(const std::string& id, const std::string& by) = 0;
  /// Units whose first sub-pass is beyond `after`, at most 1000.
  [[nodiscard]] virtual Result<UnitPage> units(const std::string& id, std::optional<std::uint64_t> after) = 0;
  [[nodiscard]] virtual Result<std::vector<ConvergencePoint>> convergence(const std::string& id) = 0;
  /// What all of a job is going to cost, from what it has cost so far. Errors: kUnavailable while that is too little to
  /// tell; kInvalidInput when neither passes nor an error bound it.
  [[nodiscard]] virtual Result<Estimate> estimate(const std::string& id, const EstimateRequest& request) = 0;
  /// Where the file lies; it does not change afterwards (it may be replaced as a whole). Errors: kUnavailable while
  /// there is none yet, or when it has expired.
  [[nodiscard]] virtual Result<std::filesystem::path> artifact(const std::string& id, Artifact kind) = 0;
  /// The image so far. Errors: kUnavailable before the first sub-pass.
  [[nodiscard]] virtual Result<std::string> preview_png(const std::string& id) = 0;
  /// The layers of a running job's image, and one of them for looking at. Errors: kUnavailable before the first
  /// sub-pass, and once the job holds no film any more: then the EXR is the image; kInvalidInput when there is no such
  /// layer.
  [[nodiscard]] virtual Result<LayerList> layers(const std::string& id) = 0;
  [[nodiscard]] virtual Result<LayerPixels> pixels(const std::string& id, const std::string& layer, int max_width) = 0;
  /// Entries after `after`, at most 1000.
  [[nodiscard]] virtual Result<std::vector<LogEntry>> logs(const std::string& id, std::uint64_t after) = 0;
  [[nodiscard]] virtual std::vector<WorkerView> workers() = 0;
  /// Errors: kUsage when no worker has this name.
  [[nodiscard]] virtual Result<WorkerView> steer(const std::string& worker, WorkerVerb verb, const std::string& by) = 0;
  /// Blocks until any job's view has changed since `version`, or `seconds` went by; returns the version now. For
  /// watching.
  [[nodiscard]] virtual std::uint64_t wait_for_change(std::uint64_t version, double seconds) = 0;
};

}  // namespace pf
