// Tasks and messages through the farm's ports over a nats-server of the bench's own, on loopback:
//   build/release/tests/pf_engine_bench

#include <benchmark/benchmark.h>

#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "common/base/event_queue.h"
#include "common/wire/nats/engine.h"
#include "jobs/nats_server.h"
#include "jobs/process.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

/// One server for all benches, gone with the process.
class Engine {
 public:
  Engine() {
    std::string pattern = (fs::temp_directory_path() / "pf-engine-bench-XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
    NatsServerOptions options;
    const char* path = std::getenv("PATH");
    options.program = find_program("nats-server", std::string(path == nullptr ? "" : path) + ":/usr/sbin");
    options.folder = folder_ / "engine";
    options.log = folder_ / "log";
    Result<NatsServer> server = NatsServer::prepare(options);
    if (server) server_.emplace(std::move(*server));
    if (!server_ || !server_->start()) std::cerr << "no nats-server here\n", std::exit(1);
  }
  ~Engine() {
    server_->stop();
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;

  [[nodiscard]] EngineOptions options(const char* name) const {
    return load_credentials(server_->credentials(name)).value();
  }

 private:
  fs::path folder_;
  std::optional<NatsServer> server_;
};

template <typename Port>
struct Endpoint {
  explicit Endpoint(const EngineOptions& options)
      : port(Port::connect(options, [this](EngineEvent event) {
               const std::size_t bytes = bytes_of(event);
               events.push(std::move(event), bytes);
             }).value()) {}
  ~Endpoint() { events.close(); }
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  EventQueue<EngineEvent> events{4096, std::size_t{64} << 20};
  std::unique_ptr<Port> port;
};

const Engine& engine() {
  static const Engine one;
  return one;
}

/// Published with the engine's word, taken, acknowledged; one after the other.
void one_task(benchmark::State& state) {
  Endpoint<NatsCoordinatorPort> coordinator(engine().options("coordinator"));
  Endpoint<NatsWorkerPort> worker(engine().options("worker-1"));
  const std::string task(300, 't');
  static int id = 0;
  for (auto _ : state) {
    if (!coordinator.port->publish_task(std::to_string(++id), task)) state.SkipWithError("not published");
    worker.port->fetch_task(5.0);
    const auto event = worker.events.pop();
    if (const auto* taken = std::get_if<TaskDelivered>(&*event)) worker.port->acknowledge(taken->delivery.handle);
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(one_task)->UseRealTime();

/// Messages of a worker to the coordinator, as fast as they go.
void messages(benchmark::State& state) {
  Endpoint<NatsCoordinatorPort> coordinator(engine().options("coordinator"));
  Endpoint<NatsWorkerPort> worker(engine().options("worker-1"));
  const std::string message(static_cast<std::size_t>(state.range(0)), 'm');
  std::jthread sender([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) worker.port->send(message);
  });
  for (auto _ : state) benchmark::DoNotOptimize(coordinator.events.pop());
  sender.request_stop();
  state.SetItemsProcessed(state.iterations());
  state.SetBytesProcessed(state.iterations() * state.range(0));
}
BENCHMARK(messages)->Arg(1000)->Arg(1000 * 1000)->UseRealTime()->MinTime(2.0);

}  // namespace
}  // namespace pf
