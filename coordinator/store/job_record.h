#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/spec/job_spec.h"
#include "common/wire/blob_store.h"
#include "coordinator/job_service.h"
#include "coordinator/unit_ledger.h"

namespace pf {

/// What outlives the coordinator's process beside a job's film.
struct JobRecord {
  std::uint64_t number = 0;  ///< in the database; 0: not there yet
  std::string id;
  JobSpec spec;
  BlobId bundle;
  std::string idempotency_key, submitted_by, paused_by;
  int max_workers = 0;    ///< 0: no bound
  std::uint64_t run = 0;  ///< times that it went on by a user's word: tasks of a run before are not wanted any more
  int extended = 0;
  std::vector<std::string> expired;  ///< "checkpoint", "results"
  JobState state = JobState::kQueued;
  std::string message;
  JobState end_state = JobState::kDone;  ///< that a finishing job is going to have
  std::int64_t submitted_unix_ms = 0, started_unix_ms = 0, ended_unix_ms = 0;
  std::string scene_hash, plan, image_hash;
  std::vector<std::string> warnings;
  double estimated_error = -1;  ///< negative: not known
  struct Figures {
    std::uint64_t passes = 0, rounds = 0, rays = 0, photon_paths = 0;
    double seconds = 0;
    std::uint64_t units_done = 0, units_repeated = 0, bytes_received = 0;
    double merge_seconds = 0;
  } figures;  ///< of the last checkpoint, or the end
};

/// What a checkpoint of the job's film must say that it is of.
[[nodiscard]] std::string checkpoint_identity(const JobRecord& record, const std::string& build_id);

/// The record of a job of before there was a database: `job.json` in the job's folder.
[[nodiscard]] Result<JobRecord> import_job_json(const std::filesystem::path& folder);

/// A result that counts, and the units in it: what a later check needs to trace them again.
struct CountedResult {
  struct Unit {
    UnitRange range;
    std::uint32_t attempts = 1;
  };
  std::uint64_t number = 0;  ///< ascending within a job
  std::string worker;
  double seconds = 0;     ///< of tracing all of it
  std::string sums_hash;  ///< XXH3-128, hexadecimal
  std::vector<Unit> units;

  [[nodiscard]] std::uint64_t passes() const {
    std::uint64_t sum = 0;
    for (const Unit& unit : units) sum += unit.range.count;
    return sum;
  }
};

/// What goes into a checkpoint beside the film: which units are in its sums, and counts that go on after a restart.
struct CheckpointNote {
  std::vector<UnitRange> done_beyond;  ///< of the contiguous sub-passes done
  std::uint64_t done_below = 0;
  double seconds = 0;
  std::uint64_t units_done = 0, units_repeated = 0, bytes_received = 0;
  double merge_seconds = 0;
  std::uint64_t next_result = 1;  ///< results of lower numbers are in the film

  [[nodiscard]] std::string to_json() const;
  [[nodiscard]] static Result<CheckpointNote> from_json(const std::string& text);
};

}  // namespace pf
