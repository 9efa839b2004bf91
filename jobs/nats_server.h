#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "jobs/child.h"
#include "jobs/farm_config.h"

namespace pf {

struct NatsServerOptions {
  std::filesystem::path program;  ///< nats-server
  std::filesystem::path folder;   ///< of configuration, credentials and the work queue; made if absent
  std::filesystem::path log;
  int workers = 1;          ///< worker-1 ... get users
  std::string certificate;  ///< PEM, with key and CA: TLS
  std::string key;
  std::string ca;
};

/// A private nats-server with JetStream on loopback. Its port and passwords are new with every prepare() and stay when
/// it is started again; the work queue in FOLDER/jetstream stays always. In FOLDER, mode 0600: nats-server.conf, and
/// credentials coordinator.toml, worker-1.toml, ...
class NatsServer {
 public:
  /// Writes the files; nothing runs yet. Errors: kInternal (disk).
  [[nodiscard]] static Result<NatsServer> prepare(NatsServerOptions options);

  /// Starts it; returns when it takes connections. Errors: kUnavailable: not there, died, not ready within `seconds`.
  [[nodiscard]] Result<Child> launch(double seconds = 15.0) const;
  /// The same; keeps it.
  [[nodiscard]] Result<void> start();
  /// SIGTERM, and SIGKILL after `seconds`.
  void stop(double seconds = 5.0);
  /// Empty before start() and after stop().
  [[nodiscard]] std::optional<Child>& child() { return child_; }

  [[nodiscard]] const std::string& url() const { return url_; }
  [[nodiscard]] int port() const { return config_.port; }
  [[nodiscard]] const std::vector<EngineUser>& users() const { return config_.users; }
  [[nodiscard]] std::filesystem::path credentials(std::string_view name) const {
    return credentials_file(options_.folder, name);
  }

 private:
  [[nodiscard]] Result<void> write_files();
  [[nodiscard]] Result<void> wait_until_ready(Child& child, std::chrono::steady_clock::time_point deadline) const;

  NatsServerOptions options_;
  NatsConfig config_;
  std::string url_;
  std::optional<Child> child_;
};

}  // namespace pf
