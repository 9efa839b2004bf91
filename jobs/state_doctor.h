#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "jobs/doctor.h"

namespace pf {

/// Looks through a farm's state folder: who works on it, its database, every job's files against the database, what
/// nobody needs, free space. Changes nothing, and may run beside the farm: the database is looked at in a copy below
/// `temporary`. `build_id`: of the farm that is to go on. Error: kUsage when the folder is none of a farm.
[[nodiscard]] Result<std::vector<Check>> examine_state(const std::filesystem::path& state,
                                                       const std::filesystem::path& temporary,
                                                       const std::string& build_id);

}  // namespace pf
