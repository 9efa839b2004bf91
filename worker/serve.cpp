#include "worker/serve.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <random>
#include <thread>
#include <variant>

#include "build_id.h"
#include "common/base/clock.h"
#include "common/base/event_queue.h"
#include "worker/farm/session.h"
#include "worker/render_executor.h"

namespace pf {
namespace {

using Event = std::variant<EngineEvent, WorkDone>;
constexpr std::size_t kMaxEvents = 256;
constexpr std::size_t kMaxEventBytes = std::size_t{64} << 20;
constexpr std::chrono::milliseconds kTick{200};

std::string host_name() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "unknown";
}

SessionOptions session_options(const ServeOptions& options, int threads) {
  SessionOptions session;
  session.name = options.engine.name;
  session.host = host_name();
  session.process = static_cast<std::uint64_t>(::getpid());
  std::random_device random;
  session.incarnation = (std::uint64_t{random()} << 32) | random();
  session.threads = static_cast<std::uint32_t>(threads);
  session.build_id = kBuildId;
  session.cache = options.cache / "jobs";
  return session;
}

void hand_over(Session& session, const Log& log, EngineEvent& event) {
  if (const auto* task = std::get_if<TaskDelivered>(&event)) {
    session.on_task(task->delivery);
  } else if (std::holds_alternative<NoTask>(event)) {
    session.on_no_task();
  } else if (const auto* message = std::get_if<MessageArrived>(&event)) {
    session.on_message(message->bytes);
  } else if (const auto* change = std::get_if<ConnectionChanged>(&event)) {
    log.info("engine", {{"up", change->up ? "yes" : "no"}, {"text", change->text}});
  } else if (const auto* problem = std::get_if<EngineProblem>(&event)) {
    log.warning("engine", {{"problem", problem->text}});
  }
}

}  // namespace

Result<void> serve_farm(const ServeOptions& options, const Log& log) {
  auto blobs = BlobStore::open(options.cache / "blobs", options.cache_bytes);
  if (!blobs) return tl::unexpected(blobs.error());
  const int threads =
      options.threads > 0 ? options.threads : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  const SystemClock clock;
  EventQueue<Event> events(kMaxEvents, kMaxEventBytes);
  auto port = NatsWorkerPort::connect(options.engine, [&](EngineEvent event) {
    const std::size_t bytes = bytes_of(event);
    events.push(Event(std::move(event)), bytes);
  });
  if (!port) return tl::unexpected(port.error());
  RenderExecutor executor(threads, clock, [&](WorkDone done) { events.push(Event(std::move(done))); });
  Session session(session_options(options, threads), **port, executor, *blobs, clock, log);
  session.start();
  while (!session.finished()) {
    auto event = events.pop(std::chrono::steady_clock::now() + kTick);
    if (event) {
      if (auto* done = std::get_if<WorkDone>(&*event)) {
        session.on_done(std::move(*done));
      } else {
        hand_over(session, log, std::get<EngineEvent>(*event));
        const auto* change = std::get_if<ConnectionChanged>(&std::get<EngineEvent>(*event));
        if (change != nullptr && change->lost) {
          events.close();
          return fail(ErrorKind::kUnavailable, change->text);
        }
      }
    }
    if (options.interrupted != nullptr && options.interrupted->load()) session.drain();
    session.tick();
  }
  events.close();
  if (session.ended_badly()) return tl::unexpected(*session.ended_badly());
  return {};
}

}  // namespace pf
