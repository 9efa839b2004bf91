#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "common/base/result.h"

namespace pf {

// The farm's two cores (coordinator/farm.h, worker/farm/session.h) do no input or output themselves: they are told what
// happened and act through the ports below. Over NATS JetStream the ports are nats_ports.h; in tests a simulation with
// a fake clock stands behind them. All calls of one core come from one thread.

/// A task as the engine handed it out.
struct Delivery {
  std::uint64_t handle = 0;  ///< for acknowledge() and the like; means nothing elsewhere
  std::string bytes;         ///< a wire Task
};

/// What the coordinator does to the outside.
class CoordinatorPort {
 public:
  virtual ~CoordinatorPort() = default;
  /// Appends a task to the work queue. `id` lets the engine drop a repetition: job, unit and attempt.
  [[nodiscard]] virtual Result<void> publish_task(std::string_view id, std::string_view bytes) = 0;
  /// Empties the work queue; tasks that workers hold stay with them.
  [[nodiscard]] virtual Result<void> purge_tasks() = 0;
  /// Sends a ToWorker to one worker; empty name: to all. May get lost.
  virtual void send(std::string_view worker, std::string_view bytes) = 0;
};

/// What a worker does to the outside.
class WorkerPort {
 public:
  virtual ~WorkerPort() = default;
  /// Asks for one task. Answered by on_task, or by on_no_task after at most `seconds` (0: at once when the queue is
  /// empty). One request at a time.
  virtual void fetch_task(double seconds) = 0;
  /// The task is done with and goes from the queue.
  virtual void acknowledge(std::uint64_t handle) = 0;
  /// The task is still being worked on: restarts the engine's AckWait.
  virtual void in_progress(std::uint64_t handle) = 0;
  /// Gives the task back: the engine hands it to another worker at once.
  virtual void give_back(std::uint64_t handle) = 0;
  /// Sends a FromWorker to the coordinator. May get lost.
  virtual void send(std::string_view bytes) = 0;
};

}  // namespace pf
