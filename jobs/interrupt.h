#pragma once

#include <atomic>

#include <csignal>

namespace pf {

/// While one lives, SIGINT and SIGTERM set its flag; a second one ends the process at once. One at a time.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

  [[nodiscard]] const std::atomic<bool>& flag() const;

 private:
  struct ::sigaction interrupt_ = {}, terminate_ = {};  ///< as they were
};

}  // namespace pf
