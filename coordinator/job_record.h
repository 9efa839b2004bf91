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

/// What outlives the coordinator's process beside a job's film: `job.json` in the job's folder, replaced as a whole.
struct JobRecord {
  std::string id;
  JobSpec spec;
  BlobId bundle;
  std::string idempotency_key;
  JobState state = JobState::kQueued;
  std::string message;
  JobState end_state = JobState::kDone; ///< that a finishing job is going to have
  std::int64_t submitted_unix_ms = 0, started_unix_ms = 0, ended_unix_ms = 0;
  std::string scene_hash, plan, image_hash;
  std::vector<std::string> warnings;
  double estimated_error = -1;          ///< negative: not known
  struct Figures {
    std::uint64_t passes = 0, rounds = 0, rays = 0, photon_paths = 0;
    double seconds = 0;
  } figures;                            ///< when it ended

  [[nodiscard]] Result<void> save(const std::filesystem::path& folder) const;
  [[nodiscard]] static Result<JobRecord> load(const std::filesystem::path& folder);
};

/// What goes into a checkpoint beside the film: which units are in its sums, and counts that go on after a restart.
struct CheckpointNote {
  std::vector<UnitRange> done_beyond;   ///< of the contiguous sub-passes done
  std::uint64_t done_below = 0;
  double seconds = 0;
  std::uint64_t units_done = 0, units_repeated = 0, bytes_received = 0;
  double merge_seconds = 0;

  [[nodiscard]] std::string to_json() const;
  [[nodiscard]] static Result<CheckpointNote> from_json(const std::string& text);
};

}  // namespace pf
