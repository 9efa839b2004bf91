#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace pf {

/// Threads that each serve one connection at a time. They grow in number with need: a watcher holds one for
/// hours.
class ConnectionThreads {
 public:
  explicit ConnectionThreads(std::size_t max_threads) : max_(max_threads) {}
  ~ConnectionThreads() { shut_down(); }
  ConnectionThreads(const ConnectionThreads&) = delete;
  ConnectionThreads& operator=(const ConnectionThreads&) = delete;

  /// False when all threads are busy and as many tasks wait: the task was not taken.
  [[nodiscard]] bool add(std::function<void()> task);
  /// Runs what was added, then ends the threads.
  void shut_down();

 private:
  void serve();

  const std::size_t max_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::thread> threads_;
  std::deque<std::function<void()>> waiting_;
  std::size_t idle_ = 0;
  bool ending_ = false;
};

}  // namespace pf
