#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <limits>
#include <mutex>
#include <optional>
#include <utility>

namespace pf {

/// A bounded queue from many threads to one: what happened outside, on its way to the thread that owns a core. Bounded
/// by the number of events and by the bytes that their producers say they hold, so that a slow consumer holds its
/// producers up instead of filling memory. An event larger than the whole bound is taken when the queue is empty.
template <typename Event>
class EventQueue {
 public:
  using Deadline = std::chrono::steady_clock::time_point;

  explicit EventQueue(std::size_t max_events, std::size_t max_bytes = std::numeric_limits<std::size_t>::max())
      : max_events_(max_events), max_bytes_(max_bytes) {}
  EventQueue(const EventQueue&) = delete;
  EventQueue& operator=(const EventQueue&) = delete;

  /// Waits for room. False: the queue was closed and the event is dropped.
  bool push(Event event, std::size_t bytes = 0) {
    std::unique_lock lock(mutex_);
    room_.wait(lock, [&] { return closed_ || has_room(bytes); });
    return put(event, bytes);
  }
  /// Waits for room until the deadline. False: closed or still full; the event is dropped.
  bool push(Event event, std::size_t bytes, Deadline deadline) {
    std::unique_lock lock(mutex_);
    return room_.wait_until(lock, deadline, [&] { return closed_ || has_room(bytes); }) && put(event, bytes);
  }
  /// Never waits. False: closed or full; the event is dropped.
  bool try_push(Event event, std::size_t bytes = 0) {
    const std::lock_guard lock(mutex_);
    return has_room(bytes) && put(event, bytes);
  }

  /// The oldest event. Empty when the queue is closed and nothing is left.
  std::optional<Event> pop() {
    std::unique_lock lock(mutex_);
    ready_.wait(lock, [&] { return closed_ || !events_.empty(); });
    return take();
  }
  /// The same; empty also when there is none until the deadline.
  std::optional<Event> pop(Deadline deadline) {
    std::unique_lock lock(mutex_);
    ready_.wait_until(lock, deadline, [&] { return closed_ || !events_.empty(); });
    return take();
  }

  /// Nothing more goes in; what is in still comes out. Wakes everybody who waits.
  void close() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    room_.notify_all();
    ready_.notify_all();
  }
  [[nodiscard]] bool closed() const {
    const std::lock_guard lock(mutex_);
    return closed_;
  }
  [[nodiscard]] std::size_t size() const {
    const std::lock_guard lock(mutex_);
    return events_.size();
  }

 private:
  bool has_room(std::size_t bytes) const {
    return events_.empty() || (events_.size() < max_events_ && bytes <= max_bytes_ && bytes_ <= max_bytes_ - bytes);
  }
  bool put(Event& event, std::size_t bytes) {
    if (closed_) return false;
    events_.emplace_back(std::move(event), bytes);
    bytes_ += bytes;
    ready_.notify_one();
    return true;
  }
  std::optional<Event> take() {
    if (events_.empty()) return std::nullopt;
    std::optional<Event> event(std::move(events_.front().first));
    bytes_ -= events_.front().second;
    events_.pop_front();
    // All of them: producers wait for different amounts of room.
    room_.notify_all();
    return event;
  }

  const std::size_t max_events_;
  const std::size_t max_bytes_;
  mutable std::mutex mutex_;
  std::condition_variable ready_;
  std::condition_variable room_;
  std::deque<std::pair<Event, std::size_t>> events_;
  std::size_t bytes_ = 0;
  bool closed_ = false;
};

}  // namespace pf
