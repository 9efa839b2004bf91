#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/base/result.h"

namespace pf {

/// How a process ended: by exit (`signal` 0) or killed by a signal.
struct ProcessEnd {
  int exit_code = 0;
  int signal = 0;
};

/// Runs a program with this process's standard streams and waits. Signals that ask this process to stop are
/// passed on, except those that a terminal has already sent to both; the program dies with this process.
/// Errors: kUnavailable when it cannot be started.
[[nodiscard]] Result<ProcessEnd> run_to_end(const std::filesystem::path& program,
                                            const std::vector<std::string>& arguments);

struct CapturedProcess {
  ProcessEnd end;
  std::string output;  ///< standard output, at most 64 KiB
};

/// A render may take that long; Ctrl-C ends it.
inline constexpr double kRenderSeconds = 30 * 86400.0;

/// Runs a program without input and reads its standard output; standard error is dropped. Killed after
/// `seconds`. Errors: kUnavailable when it cannot be started, kTimeout.
[[nodiscard]] Result<CapturedProcess> run_and_capture(const std::filesystem::path& program,
                                                      const std::vector<std::string>& arguments, double seconds);

/// The first executable file called `name` in the folders of `search_path` (as in PATH); empty if there is
/// none.
[[nodiscard]] std::filesystem::path find_program(const std::string& name, const std::string& search_path);

}  // namespace pf
