#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "jobs/client_command.h"

namespace pf {

struct VerifyUnitsOptions {
  int count = 5;
  std::optional<std::uint64_t> seed;
};

/// Recomputes units of a job of the service and compares; writes what was shown. Returns the exit code.
[[nodiscard]] int verify_units(ClientCommand& command, const std::string& what, const std::string& scene,
                               const VerifyUnitsOptions& options, const std::filesystem::path& scratch);

}  // namespace pf
