#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace pf {

enum class Health {
  kOk,
  kNote,  ///< something works less well, or only the farm needs it
  kBad    ///< this machine cannot render, or the state folder has suffered
};

/// What one look at the machine found, and what to do about it.
struct Check {
  std::string name;
  Health health = Health::kOk;
  std::string found;
  std::string hint;  ///< empty when all is well
};

/// What the checks look at; tests give folders of their own.
struct Machine {
  std::filesystem::path folder;  ///< of photonfarm-worker
  std::string search_path;       ///< PATH
  std::filesystem::path state;   ///< may not exist yet; empty: no home
  std::filesystem::path temporary;
  std::string build_id;  ///< that photonfarm-worker must have
};

[[nodiscard]] std::vector<Check> examine(const Machine& machine);

[[nodiscard]] Check check_cpu();
[[nodiscard]] Check check_worker(const std::filesystem::path& program, const std::string& build_id);
[[nodiscard]] Check check_nats(const std::string& search_path);
/// Writes a small file in the folder, or in the nearest one above it that exists, and removes it.
[[nodiscard]] Check check_writable(std::string name, const std::filesystem::path& folder);
/// Judges what `examine` measured; bytes.
[[nodiscard]] Check judge_disk(std::uint64_t free_bytes);
[[nodiscard]] Check judge_memory(std::uint64_t available_bytes);
[[nodiscard]] Check check_threads();

[[nodiscard]] std::string_view to_string(Health health);
/// False when any check is bad.
[[nodiscard]] bool all_well(const std::vector<Check>& checks);
/// A table, and the last line: `well` or `unwell`.
[[nodiscard]] std::string doctor_text(const std::vector<Check>& checks, std::string_view well, std::string_view unwell);
[[nodiscard]] nlohmann::json doctor_json(const std::vector<Check>& checks, const std::string& build_id);

}  // namespace pf
