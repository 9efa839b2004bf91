#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/base/result.h"

namespace pf::bench {

/// One call of the renderer; its files are `out`/image.exr, .json, .snapshot-<n>.exr.
struct RenderOrder {
  std::filesystem::path job;
  std::vector<std::string> set;  ///< `table.key=value`
  std::filesystem::path out;
  std::vector<double> snapshot_seconds;
  std::vector<std::int64_t> snapshot_passes;
  bool processor_time = false;  ///< seconds are of processor time
  bool resume = false;
  int threads = 1;
  double timeout = 0;  ///< seconds; 0: none
};

/// How a call ended. `error` is empty when all went well; then `figures` is the renderer's JSON document.
struct RenderOutcome {
  nlohmann::json figures;
  std::string error;
  double wall_seconds = 0;  ///< of the whole process
};

/// What renders: the real renderer in a process of its own, or what tests put in its place.
class Runner {
 public:
  virtual ~Runner() = default;
  /// `tick` is called now and then with the seconds since the start. A render that fails is an outcome; errors are
  /// kInterrupted and kUnavailable (there is no renderer).
  [[nodiscard]] virtual Result<RenderOutcome> render(const RenderOrder& order,
                                                     const std::function<void(double)>& tick) = 0;
  /// The document of `photonfarm plan --json` for a job. Errors: kInvalidInput (the scene), kUnavailable, kTimeout.
  [[nodiscard]] virtual Result<nlohmann::json> plan(const std::filesystem::path& job,
                                                    const std::vector<std::string>& set) = 0;
};

/// The name of every job that a bench renders, and so of its files.
inline constexpr const char* kImageName = "image";

}  // namespace pf::bench
