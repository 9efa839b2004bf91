#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "common/base/clock.h"
#include "worker/farm/executor.h"
#include "worker/render_job.h"

namespace pf {

/// Prepares and traces with the integrators themselves, on a thread of its own that uses `threads` threads. Keeps the
/// scenes of the latest jobs.
class RenderExecutor final : public Executor {
 public:
  /// `done` is called on the executor's thread.
  RenderExecutor(int threads, const Clock& clock, std::function<void(WorkDone)> done);
  /// Waits for the work in hand.
  ~RenderExecutor() override;

  void start(Work work) override;

 private:
  void serve();
  [[nodiscard]] WorkDone run(const Work& work);
  [[nodiscard]] Result<std::shared_ptr<const LoadedJob>> loaded(const Work& work);

  const int threads_;
  const Clock& clock_;
  const std::function<void(WorkDone)> done_;
  std::deque<std::pair<std::string, std::shared_ptr<const LoadedJob>>> scenes_;  ///< latest first
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Work> work_;
  bool closing_ = false;
  std::thread thread_;
};

}  // namespace pf
