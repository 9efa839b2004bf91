#pragma once

// A real nats-server in a folder of the test's own, and ports whose events wait in a queue.

#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "common/base/atomic_file.h"
#include "common/base/event_queue.h"
#include "common/wire/nats/engine.h"
#include "jobs/farm_certificates.h"
#include "jobs/nats_server.h"

namespace pf::farm_test {

using std::chrono::steady_clock;

/// Far enough that only a test that fails meets it, also on a busy machine.
inline constexpr double kPatience = 30.0;

inline steady_clock::time_point in(double seconds) {
  return steady_clock::now() +
         std::chrono::duration_cast<steady_clock::duration>(std::chrono::duration<double>(seconds));
}

inline double seconds_since(steady_clock::time_point start) {
  return std::chrono::duration<double>(steady_clock::now() - start).count();
}

/// A folder that goes with the test.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "pf-farm-XXXXXX").string();
    path_ = mkdtemp(pattern.data());
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

enum class Tls { kOff, kOn };

class EngineTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (find_nats_server().empty()) FAIL() << "no nats-server here; deploy/install brings it";
    start_server(Tls::kOff);
  }

  static std::filesystem::path find_nats_server() {
    const char* path = std::getenv("PATH");
    return find_program("nats-server", std::string(path == nullptr ? "" : path) + ":/usr/sbin");
  }

  void start_server(Tls tls) {
    NatsServerOptions options;
    options.program = find_nats_server();
    options.folder = folder_.path() / "engine";
    options.log = folder_.path() / "nats-server.log";
    options.workers = 3;
    if (tls == Tls::kOn) {
      const Result<Certificates> made = make_certificates({});
      ASSERT_TRUE(made) << made.error().message;
      const auto write = [&](const char* name, const std::string& text) {
        const std::filesystem::path file = folder_.path() / name;
        EXPECT_TRUE(write_file_atomically(file, text, FileAccess::kOwnerOnly));
        return file.string();
      };
      options.certificate = write("server.pem", made->server);
      options.key = write("server-key.pem", made->server_key);
      options.ca = write("ca.pem", made->ca);
    }
    Result<NatsServer> prepared = NatsServer::prepare(options);
    ASSERT_TRUE(prepared) << prepared.error().message;
    server_.reset();
    server_.emplace(std::move(*prepared));
    const Result<void> started = server_->start();
    ASSERT_TRUE(started) << started.error().message;
  }

  [[nodiscard]] EngineOptions options_of(std::string_view name) const {
    const Result<EngineOptions> options = load_credentials(server_->credentials(name));
    EXPECT_TRUE(options) << options.error().message;
    return options.value_or(EngineOptions{});
  }

  TemporaryFolder folder_;
  std::optional<NatsServer> server_;
};

/// A port and what it reported, in order of arrival.
template <typename Port>
class Endpoint {
 public:
  explicit Endpoint(const EngineOptions& options, std::size_t max_events = 100000)
      : events_(max_events, std::size_t{64} << 20) {
    Result<std::unique_ptr<Port>> made = Port::connect(options, [this](EngineEvent event) {
      const std::size_t bytes = bytes_of(event);
      events_.push(std::move(event), bytes);
    });
    EXPECT_TRUE(made) << made.error().message;
    if (made) port_ = std::move(*made);
  }
  ~Endpoint() { disconnect(); }
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  Port* operator->() { return port_.get(); }
  void disconnect() {
    events_.close();
    port_.reset();
  }
  /// The next event of this type; others before it are dropped.
  template <typename Event>
  std::optional<Event> next(double seconds = kPatience) {
    const auto deadline = in(seconds);
    while (std::optional<EngineEvent> event = events_.pop(deadline)) {
      if (Event* wanted = std::get_if<Event>(&*event)) return std::move(*wanted);
    }
    return std::nullopt;
  }
  /// A worker's next task; asks again while there is none.
  std::optional<Delivery> task(double seconds = kPatience) {
    const auto deadline = in(seconds);
    do {
      port_->fetch_task(std::min(5.0, seconds));
      while (std::optional<EngineEvent> event = events_.pop(deadline)) {
        if (TaskDelivered* task = std::get_if<TaskDelivered>(&*event)) return std::move(task->delivery);
        if (std::holds_alternative<NoTask>(*event)) break;
      }
    } while (steady_clock::now() < deadline);
    return std::nullopt;
  }
  /// Waits until the connection is down or up.
  bool wait_for_connection(bool up, double seconds = kPatience) {
    const auto deadline = in(seconds);
    while (steady_clock::now() < deadline) {
      const auto changed = next<ConnectionChanged>(seconds);
      if (changed && changed->up == up) return true;
    }
    return false;
  }
  std::size_t waiting() const { return events_.size(); }

 private:
  EventQueue<EngineEvent> events_;
  std::unique_ptr<Port> port_;
};

using Coordinator = Endpoint<NatsCoordinatorPort>;
using Worker = Endpoint<NatsWorkerPort>;

}  // namespace pf::farm_test
