#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

namespace pf {

inline constexpr std::string_view kCoordinatorUser = "coordinator";

/// A user of the engine. `name` is also the process's name and decides its permissions: "coordinator", or a worker's.
struct EngineUser {
  std::string name;
  std::string password;
};

/// The coordinator and worker-1 ... worker-N, each with a random password of 128 bits.
[[nodiscard]] Result<std::vector<EngineUser>> make_users(int workers);

/// What a nats-server of a farm is told.
struct NatsConfig {
  std::string host = "127.0.0.1";
  int port = 4222;
  std::string jetstream;    ///< folder of the work queue
  std::string pid_file;     ///< empty: none
  std::string certificate;  ///< PEM, with `key`; empty: no TLS
  std::string key;
  std::vector<EngineUser> users;
};

/// The server's configuration file. Every user has the least that it needs: a worker may publish to the coordinator
/// under its own name, ask for tasks and acknowledge them, and read what is meant for it. Passwords stand in it as they
/// are (the server reads nothing better than bcrypt, which Debian has no library for): the file is for its owner alone.
[[nodiscard]] std::string nats_config_text(const NatsConfig& config);

/// A credentials file (common/wire/nats/engine.h); `ca` may be empty.
[[nodiscard]] std::string credentials_text(const std::string& url, const EngineUser& user, const std::string& ca);

/// The coordinator's configuration (coordinator/config.h) beside the certificates that farm init makes: its HTTP API is
/// reached from other machines, with TLS.
[[nodiscard]] std::string service_config_text();

/// `FOLDER/NAME.toml`
[[nodiscard]] std::filesystem::path credentials_file(const std::filesystem::path& folder, std::string_view name);
[[nodiscard]] std::string worker_name(int number);

}  // namespace pf
