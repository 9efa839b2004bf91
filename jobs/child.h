#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "jobs/process.h"

namespace pf {

struct ChildOptions {
  std::filesystem::path program;
  std::vector<std::string> arguments;
  std::filesystem::path log;   ///< standard output and error are appended here; empty: they are dropped
  std::vector<int> cpus = {};  ///< the only processors that it may run on; empty: those of this process
};

/// A program that runs beside this one, in a process group of its own (Ctrl-C at the terminal does not reach it). The
/// kernel kills it when the thread that started it ends, however that comes about. Destroying a Child kills and reaps
/// it.
class Child {
 public:
  /// Errors: kUnavailable when it cannot be started.
  [[nodiscard]] static Result<Child> start(const ChildOptions& options);
  Child(Child&& other) noexcept;
  Child& operator=(Child&& other) noexcept;
  ~Child();

  [[nodiscard]] pid_t pid() const { return pid_; }
  /// Readable once the process has ended: for poll().
  [[nodiscard]] int pidfd() const { return pidfd_; }
  /// To all of its process group; nothing happens after its end.
  void signal(int number) const;
  /// How it ended; empty while it runs. Never waits.
  [[nodiscard]] std::optional<ProcessEnd> end();
  /// Waits for its end; empty when it still runs at the deadline.
  [[nodiscard]] std::optional<ProcessEnd> wait(std::chrono::steady_clock::time_point deadline);

 private:
  Child(pid_t pid, int pidfd) : pid_(pid), pidfd_(pidfd) {}
  void destroy();

  pid_t pid_ = 0;  ///< 0: moved from
  int pidfd_ = -1;
  std::optional<ProcessEnd> end_;
};

/// How a process ended, in words: "exited with code 3", "was killed by signal 9 (KILL)".
[[nodiscard]] std::string to_string(const ProcessEnd& end);

/// Waits until `fd` is readable; false at the deadline. Signals do not end the wait.
bool wait_readable(int fd, std::chrono::steady_clock::time_point deadline);

}  // namespace pf
