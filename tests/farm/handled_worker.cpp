#include <random>

#include <spdlog/sinks/null_sink.h>

#include "build_id.h"
#include "common/base/clock.h"
#include "common/base/event_queue.h"
#include "tests/farm/farm_fixture.h"
#include "worker/farm/session.h"
#include "worker/render_executor.h"

namespace pf::farm_test {
namespace {

using Event = std::variant<EngineEvent, WorkDone>;
constexpr std::chrono::milliseconds kTick{50};

/// The engine's port, but for what is sent to the coordinator.
class HandledPort final : public WorkerPort {
 public:
  HandledPort(WorkerPort& port, const HandledWorker::Handle& handle) : port_(port), handle_(handle) {}
  void fetch_task(double seconds) override { port_.fetch_task(seconds); }
  void acknowledge(std::uint64_t handle) override { port_.acknowledge(handle); }
  void in_progress(std::uint64_t handle) override { port_.in_progress(handle); }
  void give_back(std::uint64_t handle) override { port_.give_back(handle); }
  void send(std::string_view bytes) override {
    wire::FromWorker message;
    if (!handle_ || !message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return port_.send(bytes);
    for (const wire::FromWorker& instead : handle_(message)) port_.send(instead.SerializeAsString());
  }

 private:
  WorkerPort& port_;
  const HandledWorker::Handle& handle_;
};

SessionOptions session_options(const HandledWorker::Options& options) {
  SessionOptions session;
  session.name = options.engine.name;
  session.host = "test";
  std::random_device random;
  session.incarnation = (std::uint64_t{random()} << 32) | random();
  session.build_id = options.build_id.empty() ? kBuildId : options.build_id;
  session.cache = options.cache / "jobs";
  return session;
}

}  // namespace

HandledWorker::HandledWorker(Options options) : options_(std::move(options)), thread_([this] { serve(); }) {}

HandledWorker::~HandledWorker() {
  closing_ = true;
  thread_.join();
}

std::string HandledWorker::refusal() const {
  const std::lock_guard lock(mutex_);
  return refusal_;
}

void HandledWorker::serve() {
  auto blobs = BlobStore::open(options_.cache / "blobs", 0);
  ASSERT_TRUE(blobs) << blobs.error().message;
  const SystemClock clock;
  const Log log(LogLevel::kOff, std::make_shared<spdlog::sinks::null_sink_mt>());
  EventQueue<Event> events(1024, std::size_t{64} << 20);
  auto port = NatsWorkerPort::connect(options_.engine, [&](EngineEvent event) {
    const std::size_t bytes = bytes_of(event);
    events.push(Event(std::move(event)), bytes);
  });
  ASSERT_TRUE(port) << port.error().message;
  RenderExecutor executor(1, clock, [&](WorkDone done) { events.push(Event(std::move(done))); });
  HandledPort handled(**port, options_.handle);
  Session session(session_options(options_), handled, executor, *blobs, clock, log);
  session.start();
  while (!session.finished() && !closing_) {
    if (auto event = events.pop(steady_clock::now() + kTick)) {
      if (auto* done = std::get_if<WorkDone>(&*event)) {
        session.on_done(std::move(*done));
      } else if (auto& engine = std::get<EngineEvent>(*event); auto* task = std::get_if<TaskDelivered>(&engine)) {
        session.on_task(task->delivery);
      } else if (std::holds_alternative<NoTask>(engine)) {
        session.on_no_task();
      } else if (const auto* message = std::get_if<MessageArrived>(&engine)) {
        session.on_message(message->bytes);
      }
    }
    session.tick();
  }
  events.close();
  const std::lock_guard lock(mutex_);
  if (session.ended_badly()) refusal_ = session.ended_badly()->message;
}

}  // namespace pf::farm_test
