#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <ostream>
#include <string>
#include <vector>

namespace pf::test {

/// How a process ended: by itself or by a signal.
struct ProcessEnd {
  int code = -1;   ///< exit code, or -1
  int signal = 0;  ///< or the signal that killed it
  static ProcessEnd exited(int code) { return {code, 0}; }
  static ProcessEnd killed(int signal) { return {-1, signal}; }
  bool operator==(const ProcessEnd&) const = default;
};
std::ostream& operator<<(std::ostream& out, const ProcessEnd& end);

/// A child process with its output in files; killed when it is still there at the end of its scope.
class Process {
 public:
  /// `max_file_bytes`: a file cannot grow beyond it, as on a full disk (0: no bound). `folder` takes the
  /// output files.
  Process(const std::filesystem::path& program, const std::vector<std::string>& arguments,
          const std::filesystem::path& folder, std::uint64_t max_file_bytes = 0);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  [[nodiscard]] bool running();
  void signal(int number);
  /// Waits for the end; kills the process when the deadline passes (seen as killed by SIGABRT, which nobody
  /// sends here).
  [[nodiscard]] ProcessEnd wait(double seconds);
  /// Readable once the process has ended (pidfd).
  [[nodiscard]] int descriptor() const { return pidfd_; }
  [[nodiscard]] const std::filesystem::path& stdout_file() const { return stdout_; }
  [[nodiscard]] const std::filesystem::path& stderr_file() const { return stderr_; }

 private:
  void collect();

  std::filesystem::path stdout_, stderr_;
  pid_t pid_ = -1;
  int pidfd_ = -1;
  bool ended_ = false;
  ProcessEnd end_;
};

/// Tells what happens in a folder: files made, or put in place by renaming.
class FolderWatch {
 public:
  explicit FolderWatch(const std::filesystem::path& folder);
  ~FolderWatch();
  FolderWatch(const FolderWatch&) = delete;
  FolderWatch& operator=(const FolderWatch&) = delete;

  /// Waits for the next event; false when the process ends or the seconds pass before it.
  [[nodiscard]] bool wait_for_any(const Process& process, double seconds);

 private:
  int fd_;
  std::vector<char> buffer_;
  std::size_t begin_ = 0, end_ = 0;
};

}  // namespace pf::test
