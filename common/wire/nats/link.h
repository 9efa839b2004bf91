#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <nats/nats.h>

#include "common/base/event_queue.h"
#include "common/base/result.h"
#include "common/wire/nats/engine.h"

namespace pf::engine {

struct MsgDeleter {
  void operator()(natsMsg* message) const { natsMsg_Destroy(message); }
};
using Message = std::unique_ptr<natsMsg, MsgDeleter>;
[[nodiscard]] std::string_view data_of(const natsMsg* message);

/// A connection to the engine, what both ports have in common: it comes back by itself, sends on a thread of its own
/// and hands received messages over on one thread for each subscription.
class Link {
 public:
  enum class IfDown {
    kDrop,  ///< worth nothing later
    kKeep   ///< the client keeps it (up to 8 MiB) and sends it when the connection is back
  };

  /// `reconnected` is called on the client's thread after the subscriptions have been made again; it must not wait.
  [[nodiscard]] static Result<std::unique_ptr<Link>> open(const EngineOptions& options, EventSink sink,
                                                          std::function<void()> reconnected);
  /// Sends what waits (2 s), disconnects and waits for all threads.
  ~Link();
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  /// False while the engine is out of reach; never waits, unlike the client's own functions, which share a lock with
  /// writes.
  [[nodiscard]] bool up() const { return up_.load(); }
  [[nodiscard]] natsConnection* connection() const { return connection_; }
  [[nodiscard]] const EventSink& sink() const { return sink_; }
  [[nodiscard]] const std::string& url() const { return url_; }
  [[nodiscard]] EngineCounters counters() const;

  /// Queues a message. It is dropped after a second without room.
  void post(std::string subject, std::string_view bytes, IfDown if_down, std::string reply = {});
  /// Calls `taken` for each message, on a thread of its own. `idle` is called between messages, at least about every
  /// `idle_milliseconds`.
  [[nodiscard]] Result<void> listen(const std::string& subject, std::function<void(Message message)> taken,
                                    std::function<void()> idle = {}, int idle_milliseconds = 60000);
  /// Returns when the engine knows all subscriptions.
  [[nodiscard]] Result<void> flush();

  /// `engine URL: WHAT: the client's words; hint`.
  [[nodiscard]] std::string describe(std::string_view what, natsStatus status) const;
  [[nodiscard]] tl::unexpected<Error> failure(std::string_view what, natsStatus status) const;

 private:
  struct Outgoing {
    std::string subject;
    std::string reply;
    std::string bytes;
    IfDown if_down;
  };

  Link(const EngineOptions& options, EventSink sink, std::function<void()> reconnected);
  void send_all();
  void report(EngineEvent event);
  void count_sent(natsStatus status, std::size_t bytes);
  static void on_disconnected(natsConnection* connection, void* self);
  static void on_reconnected(natsConnection* connection, void* self);
  static void on_closed(natsConnection* connection, void* self);
  static void on_error(natsConnection* connection, natsSubscription* subscription, natsStatus status, void* self);

  const std::string url_;
  const EventSink sink_;
  const std::function<void()> reconnected_;
  const std::size_t max_pending_bytes_;
  natsConnection* connection_ = nullptr;
  std::vector<natsSubscription*> subscriptions_;
  std::vector<std::thread> threads_;
  std::thread sender_;
  EventQueue<Outgoing> outgoing_;
  // The client calls back for all connections of a process on one thread, which therefore must not wait for a sink:
  // what it reports goes through a queue and thread of this connection's own.
  std::thread reporter_;
  EventQueue<EngineEvent> reports_;
  std::atomic<bool> up_{false};
  std::atomic<bool> closing_{false};
  std::mutex mutex_;
  std::condition_variable closed_changed_;
  bool closed_ = false;
  std::atomic<std::uint64_t> sent_{0}, sent_bytes_{0}, dropped_{0}, received_{0}, received_bytes_{0}, reconnects_{0};
};

}  // namespace pf::engine
