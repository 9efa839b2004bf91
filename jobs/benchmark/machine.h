#pragma once

#include <filesystem>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "common/base/result.h"

namespace pf::bench {

/// Processor, cores, caches, frequency governor, memory, system and what this program was built with; what the system
/// does not tell is null. `worker`: SHA-256 of the renderer, beside its build id.
[[nodiscard]] nlohmann::json describe_machine(const std::string& worker);

/// Load averages over 1, 5 and 15 minutes.
[[nodiscard]] nlohmann::json load_averages();

}  // namespace pf::bench
