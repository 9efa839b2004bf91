#include "coordinator/http/connection_threads.h"

#include <system_error>
#include <utility>

namespace pf {

bool ConnectionThreads::add(std::function<void()> task) {
  const std::lock_guard lock(mutex_);
  if (ending_) return false;
  if (idle_ <= waiting_.size() && threads_.size() < max_) {
    try {
      threads_.emplace_back([this] { serve(); });
    } catch (const std::system_error&) {  // the system has no more threads: wait for one of ours
      if (threads_.empty()) return false;
    }
  }
  if (waiting_.size() >= max_) return false;
  waiting_.push_back(std::move(task));
  changed_.notify_one();
  return true;
}

void ConnectionThreads::serve() {
  std::unique_lock lock(mutex_);
  while (true) {
    ++idle_;
    changed_.wait(lock, [this] { return ending_ || !waiting_.empty(); });
    --idle_;
    if (waiting_.empty()) return;
    const std::function<void()> task = std::move(waiting_.front());
    waiting_.pop_front();
    lock.unlock();
    task();
    lock.lock();
  }
}

void ConnectionThreads::shut_down() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

}  // namespace pf
