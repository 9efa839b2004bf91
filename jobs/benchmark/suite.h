#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

namespace pf::bench {

/// How a reference image is made: two halves of different seeds, each rendered in doubling numbers of passes.
struct ReferenceSettings {
  std::string type = "path";     ///< integrator.type
  std::vector<std::string> set;  ///< more keys of the job, `table.key=value`
  std::int64_t passes = 64;      ///< of each half, at least
  std::int64_t max_passes = 0;   ///< of each half, at most; 0: `passes`
  double seconds = 0;            ///< no further doubling once a half has taken these; 0: no bound
  double confidence = 0;         ///< relMSE of the reference's own noise that is good enough; 0: go on to the bounds
};

/// A scene: a job file, or a glTF file put into a template job.
struct SceneEntry {
  std::string name;
  std::filesystem::path job;
  std::filesystem::path gltf;  ///< empty: the job's own scene
  std::vector<std::string> set;
  int width = 0, height = 0;  ///< 0: the job's
  ReferenceSettings reference;
};

/// A method with its parameters.
struct MethodEntry {
  std::string name;
  std::string type;  ///< integrator.type
  std::vector<std::string> set;
  bool ablate = false;  ///< each term of its plan the other way round, too
};

enum class TimeAxis { kWall, kCpu };

/// What `photonfarm bench` runs; see README.md of this folder.
struct Suite {
  std::string name;
  std::vector<double> seconds;       ///< budgets, ascending; or
  std::vector<std::int64_t> passes;  ///< these
  int repetitions = 3;
  std::uint64_t first_seed = 1;
  int threads = 1;
  std::uint64_t shuffle = 1;                         ///< seed of the order of runs
  double timeout = 0;                                ///< seconds of a run; 0: ten times the last budget and a minute
  TimeAxis time = TimeAxis::kWall;                   ///< of budgets, charts, fits and tables
  std::vector<double> targets = {0.1, 0.01, 0.001};  ///< relMSE whose times are tabled
  std::vector<SceneEntry> scenes;
  std::vector<MethodEntry> methods;

  [[nodiscard]] bool by_seconds() const { return !seconds.empty(); }
  [[nodiscard]] std::size_t runs() const {
    return scenes.size() * methods.size() * static_cast<std::size_t>(repetitions);
  }
};

/// Reads and checks a suite; the `set` lists and job files themselves are checked when the jobs are loaded. Patterns of
/// `gltf` that match nothing add no scene and a line to `notes`. Errors: kInvalidSpec, `file:line:column: what is
/// wrong; what was expected; nearest valid name`.
[[nodiscard]] Result<Suite> load_suite(const std::filesystem::path& file, std::vector<std::string>& notes);
/// The same from text; relative paths start from `folder`.
[[nodiscard]] Result<Suite> parse_suite(std::string_view text, std::string_view origin,
                                        const std::filesystem::path& folder, std::vector<std::string>& notes);

/// Every key that a suite may hold, `table.key`; for the check that the documentation names them all.
[[nodiscard]] std::vector<std::string> suite_keys();

}  // namespace pf::bench
