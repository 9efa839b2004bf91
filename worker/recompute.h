#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/result.h"
#include "common/spec/job_spec.h"

namespace pf {

struct RecomputeRequest {
  JobSpec spec;
  std::filesystem::path checkpoint;  ///< of the farm's job; empty: none
  std::vector<std::string> units;    ///< each FIRST:COUNT,FIRST:COUNT...: what one result brought
  int threads = 0;                   ///< 0: all of the machine
};

/// Traces units of a farm's job again, as a worker does, and gives the hash that each result's sums have:
/// JSON
/// `{"results": [{"units", "hash", "bytes"} or {"units", "cannot"}], "state_bytes"}`, bytes as they cross the
/// network. With shared radii a unit can be traced again while its round's radii are known: in the first
/// round, and in the one that the checkpoint holds open. Errors: of spec and scene; kUsage for units that are
/// none; kInvalidInput for a checkpoint of another job.
[[nodiscard]] Result<std::string> recompute_units(const RecomputeRequest& request, const Clock& clock);

}  // namespace pf
