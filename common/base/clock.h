#pragma once

#include <atomic>
#include <chrono>
#include <ctime>

namespace pf {

/// Time as a seam: code that waits or measures takes a Clock, so that tests decide what time it is.
class Clock {
 public:
  virtual ~Clock() = default;
  /// Seconds since an arbitrary start; never runs backwards.
  [[nodiscard]] virtual double now() const = 0;
};

class SystemClock final : public Clock {
 public:
  [[nodiscard]] double now() const override {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }
};

/// Processor time of this process, over all its threads: what it costs whatever else the machine does.
class ProcessorClock final : public Clock {
 public:
  [[nodiscard]] double now() const override {
    timespec now{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }
};

/// Stands still until told. May be read and advanced from several threads.
class FakeClock final : public Clock {
 public:
  explicit FakeClock(double start_seconds = 0.0) : now_(start_seconds) {}
  [[nodiscard]] double now() const override { return now_.load(); }
  void advance(double seconds) { now_.fetch_add(seconds); }

 private:
  std::atomic<double> now_;
};

}  // namespace pf
