#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

#include "common/wire/nats/link.h"

namespace pf::engine {

/// Takes tasks from the work queue, one at a time, in JetStream's own protocol: the client's pull subscription needs
/// the queue to exist when it binds and waits for its timeout when the server was restarted; here a request is put
/// again. Answers come to `INBOX.task.NUMBER`, so that the word of an earlier request is not taken for this one's.
class TaskFetcher {
 public:
  /// `inbox`: prefix that this process may subscribe below.
  explicit TaskFetcher(std::string inbox) : inbox_(std::move(inbox) + ".task.") {}

  [[nodiscard]] Result<void> start(Link& link);
  /// The connection is back: what was asked for is asked again.
  void on_reconnected();

  void fetch(double seconds);
  void acknowledge(std::uint64_t handle) { finish(handle, "+ACK"); }
  void give_back(std::uint64_t handle) { finish(handle, "-NAK"); }
  void in_progress(std::uint64_t handle);

 private:
  using Time = std::chrono::steady_clock::time_point;

  void ask();
  void take(Message message);
  void take_task(Message message);
  void look_at_the_time();
  void finish(std::uint64_t handle, std::string_view word);

  const std::string inbox_;
  Link* link_ = nullptr;
  std::mutex mutex_;
  // The request under way; nothing of it counts while `waiting_` is false.
  bool waiting_ = false;
  bool at_once_ = false;
  std::uint64_t request_ = 0;
  Time deadline_;
  Time ask_again_;
  std::uint64_t last_handle_ = 0;
  std::map<std::uint64_t, std::string> acks_;  ///< where the word on a task goes
};

}  // namespace pf::engine
