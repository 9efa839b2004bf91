#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "jobs/child.h"

namespace pf {

/// One program that a farm keeps running.
struct Service {
  std::string name;
  std::function<Result<Child>()> start;
  /// In which it is asked to stop: all of a lower stage have ended before a higher one is asked.
  int stop_stage = 0;
  double stop_seconds = 30.0;  ///< between SIGTERM and SIGKILL
  bool needed = false;         ///< the farm cannot go on when it is given up
};

/// How long to wait before a program that ended is started again: a quarter of a second, and twice as long, up to 32 s,
/// each time that it did not even run for three. One that is killed at work is not kept from it.
class RestartPause {
 public:
  /// It ended, having run for so long.
  [[nodiscard]] std::chrono::milliseconds after(std::chrono::steady_clock::duration ran);

 private:
  int failures_ = 0;
};

/// Starts services in their order, starts again what ends (RestartPause), and stops them all when asked to. A service
/// whose exit code says that trying again is no use (2: usage or another build, 3: input) is given up; when that is a
/// needed one, or nothing else is left of its stage, so is the farm. Single-threaded; the kernel kills the services
/// when it dies, however that comes about.
class Supervisor {
 public:
  struct Options {
    std::vector<Service> services;
    std::filesystem::path watched;  ///< `appeared` is called when this file was written
    std::function<void()> appeared;
    std::function<void(const std::string& line)> say;
  };
  explicit Supervisor(Options options);
  ~Supervisor();
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  /// Until SIGINT, SIGTERM or SIGHUP; a second one kills what has not stopped. Errors: of a service that cannot be
  /// started, or that was given up with all that depends on it.
  [[nodiscard]] Result<void> run();

 private:
  using Time = std::chrono::steady_clock::time_point;
  struct Running {
    Service service;
    std::optional<Child> child;
    std::optional<Time> start_at;  ///< of the next try
    Time started;
    RestartPause pause;
    bool given_up = false;
  };

  [[nodiscard]] Result<void> listen();
  [[nodiscard]] Result<void> start(Running& running);
  [[nodiscard]] Result<void> take_end(Running& running, const ProcessEnd& end);
  [[nodiscard]] Result<void> look_after_all();
  [[nodiscard]] bool stage_is_lost(int stage) const;
  void wait(std::optional<Time> until);
  void take_signals();
  void take_changes();
  void stop_all();
  void stop_stage(int stage);

  Options options_;
  std::vector<Running> all_;
  int signals_fd_ = -1;
  int changes_fd_ = -1;
  int signals_ = 0;  ///< that asked to stop
};

}  // namespace pf
