#include <atomic>

#include <fmt/format.h>

#include "common/wire/nats/engine.h"
#include "common/wire/nats/link.h"
#include "common/wire/nats/subjects.h"

namespace pf {
namespace {

using engine::Link;

constexpr std::int64_t kAnswerMs = 1000;  // the event loop waits no longer for the engine
constexpr std::int64_t kSecond = 1000000000;
constexpr std::int64_t kMaxWorkers = 4096;  // that may ask for a task at once

struct JetStreamDeleter {
  void operator()(jsCtx* context) const { jsCtx_Destroy(context); }
};
using JetStream = std::unique_ptr<jsCtx, JetStreamDeleter>;

/// Work queue: a task goes to one worker and disappears with its ack. Full, it refuses new tasks instead of dropping
/// old ones.
natsStatus make_stream(jsCtx* js, std::uint64_t max_bytes, jsErrCode* error) {
  const char* subjects[] = {engine::kTaskSubject};
  jsStreamConfig config;
  jsStreamConfig_Init(&config);
  config.Name = engine::kStream;
  config.Subjects = subjects;
  config.SubjectsLen = 1;
  config.Retention = js_WorkQueuePolicy;
  config.Storage = js_FileStorage;
  config.Discard = js_DiscardNew;
  config.MaxBytes = static_cast<std::int64_t>(max_bytes);
  natsStatus status = js_AddStream(nullptr, js, &config, nullptr, error);
  if (status != NATS_OK && *error == JSStreamNameExistErr)
    status = js_UpdateStream(nullptr, js, &config, nullptr, error);
  return status;
}

/// The one durable consumer that all workers pull from. Deliveries are not counted here: the ledger counts attempts.
natsStatus make_consumer(jsCtx* js, double ack_wait_seconds, jsErrCode* error) {
  jsConsumerConfig config;
  jsConsumerConfig_Init(&config);
  config.Durable = engine::kConsumer;
  config.AckPolicy = js_AckExplicit;
  config.AckWait = static_cast<std::int64_t>(ack_wait_seconds * kSecond);
  config.MaxDeliver = -1;
  config.MaxAckPending = 65536;
  config.MaxWaiting = kMaxWorkers;
  config.FilterSubject = engine::kTaskSubject;
  return js_AddConsumer(nullptr, js, engine::kStream, &config, nullptr, error);
}

}  // namespace

struct NatsCoordinatorPort::Impl {
  EngineOptions options;
  std::unique_ptr<Link> link;
  JetStream js;

  Result<void> make_work_queue() {
    jsErrCode error{};
    natsStatus status = make_stream(js.get(), options.max_tasks_bytes, &error);
    if (status == NATS_OK) status = make_consumer(js.get(), options.ack_wait_seconds, &error);
    if (status == NATS_OK) return {};
    if (error != 0) {
      return fail(
          ErrorKind::kUnavailable,
          fmt::format("engine {}: the work queue {} cannot be made: {}; is it another program's, or made by another "
                      "version? `nats stream info {}` shows it",
                      link->url(), engine::kStream, nats_GetLastError(nullptr), engine::kStream));
    }
    return link->failure("the work queue cannot be made", status);
  }

  natsStatus publish(std::string_view id, std::string_view bytes, jsErrCode* error) {
    const std::string id_text(id);
    jsPubOptions how;
    jsPubOptions_Init(&how);
    how.MaxWait = kAnswerMs;
    how.MsgId = id_text.c_str();
    return js_Publish(nullptr, js.get(), engine::kTaskSubject, bytes.data(), static_cast<int>(bytes.size()), &how,
                      error);
  }
};

NatsCoordinatorPort::NatsCoordinatorPort(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
NatsCoordinatorPort::~NatsCoordinatorPort() = default;

Result<std::unique_ptr<NatsCoordinatorPort>> NatsCoordinatorPort::connect(const EngineOptions& options,
                                                                          EventSink sink) {
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  Result<std::unique_ptr<Link>> link = Link::open(options, sink, {});
  if (!link) return tl::unexpected(link.error());
  impl->link = std::move(*link);

  jsOptions how;
  jsOptions_Init(&how);
  how.Wait = kAnswerMs;
  jsCtx* js = nullptr;
  const natsStatus status = natsConnection_JetStream(&js, impl->link->connection(), &how);
  if (status != NATS_OK) return impl->link->failure("no JetStream", status);
  impl->js.reset(js);
  if (Result<void> made = impl->make_work_queue(); !made) return tl::unexpected(made.error());

  Result<void> listening = impl->link->listen(engine::kFromWorkers, [sink = std::move(sink)](engine::Message message) {
    const std::string_view subject = natsMsg_GetSubject(message.get());
    sink(MessageArrived{std::string(subject.substr(subject.rfind('.') + 1)),
                        std::string(engine::data_of(message.get()))});
  });
  if (listening) listening = impl->link->flush();
  if (!listening) return tl::unexpected(listening.error());
  return std::unique_ptr<NatsCoordinatorPort>(new NatsCoordinatorPort(std::move(impl)));
}

Result<void> NatsCoordinatorPort::publish_task(std::string_view id, std::string_view bytes) {
  if (!impl_->link->up()) return impl_->link->failure("task not published", NATS_CONNECTION_DISCONNECTED);
  jsErrCode error{};
  natsStatus status = impl_->publish(id, bytes, &error);
  if (status == NATS_NO_RESPONDERS) {
    // The server came back without its files, or somebody removed the queue.
    if (Result<void> made = impl_->make_work_queue(); !made) return made;
    status = impl_->publish(id, bytes, &error);
  }
  if (status != NATS_OK) return impl_->link->failure("task not published", status);
  return {};
}

Result<void> NatsCoordinatorPort::purge_tasks() {
  if (!impl_->link->up()) return impl_->link->failure("tasks not purged", NATS_CONNECTION_DISCONNECTED);
  jsErrCode error{};
  // Never with a filter: server 2.9.10 may then skip other tasks.
  const natsStatus status = js_PurgeStream(impl_->js.get(), engine::kStream, nullptr, &error);
  if (status == NATS_NOT_FOUND) return {};
  if (status != NATS_OK) return impl_->link->failure("tasks not purged", status);
  return {};
}

void NatsCoordinatorPort::send(std::string_view worker, std::string_view bytes) {
  impl_->link->post(worker.empty() ? engine::kAllWorkers : engine::to_worker(worker), bytes, Link::IfDown::kDrop);
}

EngineCounters NatsCoordinatorPort::counters() const { return impl_->link->counters(); }

}  // namespace pf
