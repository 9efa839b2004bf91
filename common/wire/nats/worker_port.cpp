#include "common/wire/nats/engine.h"
#include "common/wire/nats/link.h"
#include "common/wire/nats/subjects.h"
#include "common/wire/nats/task_fetcher.h"

namespace pf {

using engine::Link;

struct NatsWorkerPort::Impl {
  explicit Impl(const EngineOptions& options)
      : to_coordinator(engine::to_coordinator(options.name)),
        fetcher(options.inbox_prefix.empty() ? engine::inbox_prefix(options.name) : options.inbox_prefix) {}

  const std::string to_coordinator;
  engine::TaskFetcher fetcher;
  std::unique_ptr<Link> link;  // last: its threads call the fetcher
};

NatsWorkerPort::NatsWorkerPort(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
NatsWorkerPort::~NatsWorkerPort() = default;

Result<std::unique_ptr<NatsWorkerPort>> NatsWorkerPort::connect(const EngineOptions& options, const EventSink& sink) {
  auto impl = std::make_unique<Impl>(options);
  Result<std::unique_ptr<Link>> link =
      Link::open(options, sink, [fetcher = &impl->fetcher] { fetcher->on_reconnected(); });
  if (!link) return tl::unexpected(link.error());
  impl->link = std::move(*link);
  Result<void> listening;
  for (const std::string& subject : {engine::to_worker(options.name), std::string(engine::kAllWorkers)}) {
    listening = impl->link->listen(subject, [sink](engine::Message message) {
      sink(MessageArrived{{}, std::string(engine::data_of(message.get()))});
    });
    if (!listening) return tl::unexpected(listening.error());
  }
  listening = impl->fetcher.start(*impl->link);
  if (listening) listening = impl->link->flush();
  if (!listening) return tl::unexpected(listening.error());
  return std::unique_ptr<NatsWorkerPort>(new NatsWorkerPort(std::move(impl)));
}

void NatsWorkerPort::fetch_task(double seconds) { impl_->fetcher.fetch(seconds); }
void NatsWorkerPort::acknowledge(std::uint64_t handle) { impl_->fetcher.acknowledge(handle); }
void NatsWorkerPort::in_progress(std::uint64_t handle) { impl_->fetcher.in_progress(handle); }
void NatsWorkerPort::give_back(std::uint64_t handle) { impl_->fetcher.give_back(handle); }
void NatsWorkerPort::send(std::string_view bytes) {
  impl_->link->post(impl_->to_coordinator, bytes, Link::IfDown::kDrop);
}
EngineCounters NatsWorkerPort::counters() const { return impl_->link->counters(); }

}  // namespace pf
