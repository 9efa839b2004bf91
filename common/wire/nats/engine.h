#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <variant>

#include "common/base/result.h"
#include "common/wire/ports.h"

namespace pf {

/// How to reach the engine, and who one is there.
struct EngineOptions {
  std::string url;   ///< nats://HOST:PORT or tls://HOST:PORT; several with commas between
  std::string name;  ///< of this process: "coordinator", or the worker's; [A-Za-z0-9_-]{1,64}
  std::string user;  ///< with `password`, or empty
  std::string password;
  std::filesystem::path credentials;  ///< NATS .creds file (JWT and key) instead of user and password
  std::filesystem::path ca;           ///< whose server certificates are trusted; makes TLS a must
  std::filesystem::path certificate;  ///< of this process, with `key`; for servers that ask for one
  std::filesystem::path key;
  std::string inbox_prefix;        ///< by default _INBOX.NAME, which is what the permissions of `farm init` allow
  double ack_wait_seconds = 30.0;  ///< coordinator: a task that no worker reports on for so long goes to another
  std::uint64_t max_tasks_bytes = std::uint64_t{256} << 20;  ///< coordinator: bound of the work queue on disk
  std::size_t max_outgoing_bytes = std::size_t{16} << 20;    ///< messages that wait to be sent
  std::size_t max_pending_bytes = std::size_t{256} << 20;    ///< messages that wait to be taken; more get lost
};

/// Reads what `photonfarm farm init` writes for one process: a TOML file with url, name, user, password, ca,
/// certificate, key (paths relative to the file). Errors: kUsage, naming file, line and key; also when others than the
/// owner may read it.
[[nodiscard]] Result<EngineOptions> load_credentials(const std::filesystem::path& file);

struct TaskDelivered {
  Delivery delivery;
};
struct NoTask {};
/// `worker`: coordinator: the last part of the subject that carried the message, which the engine lets only that worker
/// publish to; worker: empty.
struct MessageArrived {
  std::string worker;
  std::string bytes;
};
/// `lost`: the engine refused this process for good (wrong password, say); it will not be tried again.
struct ConnectionChanged {
  bool up = false;
  bool lost = false;
  std::string text;
};
/// Something that the engine complained about: a missing permission, messages that were dropped. For the log.
struct EngineProblem {
  std::string text;
};
using EngineEvent = std::variant<TaskDelivered, NoTask, MessageArrived, ConnectionChanged, EngineProblem>;

/// Bytes that an event holds, for the bound of an EventQueue.
[[nodiscard]] std::size_t bytes_of(const EngineEvent& event);

/// Takes events; called on threads of the port, one event of a kind at a time. It may wait, as a full queue does:
/// messages then stay with the port (up to max_pending_bytes). Whoever destroys the port makes sure first that it waits
/// no longer (EventQueue::close).
using EventSink = std::function<void(EngineEvent event)>;

/// Figures since the port was made.
struct EngineCounters {
  std::uint64_t sent = 0;
  std::uint64_t sent_bytes = 0;
  std::uint64_t dropped = 0;  ///< not sent: no connection, no room, too large
  std::uint64_t received = 0;
  std::uint64_t received_bytes = 0;
  std::uint64_t reconnects = 0;
};

// The ports over NATS JetStream. A lost connection is tried again for ever (a quarter of a second to 2 s apart, with
// jitter); until then messages are dropped and tasks refused, and the cores try again. Messages go out on a thread of
// the port: send() waits at most a second, and only when max_outgoing_bytes wait already.

class NatsCoordinatorPort final : public CoordinatorPort {
 public:
  /// Connects, makes the work queue or brings it up to date, listens. Errors: kUnavailable, kUsage (options).
  [[nodiscard]] static Result<std::unique_ptr<NatsCoordinatorPort>> connect(const EngineOptions& options,
                                                                            EventSink sink);
  ~NatsCoordinatorPort() override;

  /// Waits for the engine's word, about 1 s at most. Errors: kUnavailable; the task may be there nevertheless, and a
  /// second try with the same id does no harm for two minutes.
  [[nodiscard]] Result<void> publish_task(std::string_view id, std::string_view bytes) override;
  [[nodiscard]] Result<void> purge_tasks() override;
  void send(std::string_view worker, std::string_view bytes) override;
  [[nodiscard]] EngineCounters counters() const;

 private:
  struct Impl;
  explicit NatsCoordinatorPort(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

class NatsWorkerPort final : public WorkerPort {
 public:
  /// Connects and listens; the work queue may come later. Errors: kUnavailable, kUsage (options).
  [[nodiscard]] static Result<std::unique_ptr<NatsWorkerPort>> connect(const EngineOptions& options,
                                                                       const EventSink& sink);
  /// Sends what waits to be sent, for at most a few seconds.
  ~NatsWorkerPort() override;

  /// At most 10 s at a time. A task that comes after the answer NoTask is given back.
  void fetch_task(double seconds) override;
  void acknowledge(std::uint64_t handle) override;
  void in_progress(std::uint64_t handle) override;
  void give_back(std::uint64_t handle) override;
  void send(std::string_view bytes) override;
  [[nodiscard]] EngineCounters counters() const;

 private:
  struct Impl;
  explicit NatsWorkerPort(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace pf
