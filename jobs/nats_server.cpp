#include "jobs/nats_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <random>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "common/base/atomic_file.h"

namespace pf {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

// Below the kernel's range for outgoing connections: a client that keeps trying to reach a stopped server on a port of
// that range can end up connected to itself, and then holds the port.
constexpr int kFirstPort = 20000;
constexpr int kPorts = 12000;

class Socket {
 public:
  Socket() : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {}
  ~Socket() {
    if (fd_ >= 0) close(fd_);
  }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  [[nodiscard]] int fd() const { return fd_; }

 private:
  int fd_;
};

sockaddr_in loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

bool is_free(int port) {
  const Socket probe;
  const int on = 1;
  setsockopt(probe.fd(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const sockaddr_in address = loopback(port);
  return bind(probe.fd(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

int find_free_port() {
  std::random_device random;
  const int start = static_cast<int>(random() % kPorts);
  for (int i = 0; i < kPorts; ++i) {
    const int port = kFirstPort + (start + i) % kPorts;
    if (is_free(port)) return port;
  }
  return 0;
}

/// A nats-server greets with its facts, also before TLS.
bool greets(int port, steady_clock::time_point deadline) {
  const Socket probe;
  const sockaddr_in address = loopback(port);
  if (connect(probe.fd(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) return false;
  if (!wait_readable(probe.fd(), deadline)) return false;
  std::array<char, 5> word{};
  return recv(probe.fd(), word.data(), word.size(), MSG_WAITALL) == 5 &&
         std::string_view(word.data(), word.size()) == "INFO ";
}

}  // namespace

Result<NatsServer> NatsServer::prepare(NatsServerOptions options) {
  NatsServer server;
  server.options_ = std::move(options);
  const NatsServerOptions& wanted = server.options_;
  Result<std::vector<EngineUser>> users = make_users(wanted.workers);
  if (!users) return tl::unexpected(users.error());
  server.config_.port = find_free_port();
  if (server.config_.port == 0) return fail(ErrorKind::kUnavailable, "nats-server: no free port on 127.0.0.1");
  server.config_.jetstream = (wanted.folder / "jetstream").string();
  server.config_.pid_file = (wanted.folder / "nats-server.pid").string();
  server.config_.certificate = wanted.certificate;
  server.config_.key = wanted.key;
  server.config_.users = std::move(*users);
  server.url_ = fmt::format("{}://127.0.0.1:{}", wanted.certificate.empty() ? "nats" : "tls", server.config_.port);
  if (Result<void> written = server.write_files(); !written) return tl::unexpected(written.error());
  return server;
}

Result<void> NatsServer::write_files() {
  std::error_code error;
  std::filesystem::create_directories(options_.folder, error);
  if (error) {
    return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", options_.folder.string(), error.message()));
  }
  chmod(options_.folder.c_str(), 0700);
  Result<void> written =
      write_file_atomically(options_.folder / "nats-server.conf", nats_config_text(config_), FileAccess::kOwnerOnly);
  for (const EngineUser& user : config_.users) {
    if (!written) return written;
    written = write_file_atomically(credentials(user.name), credentials_text(url_, user, options_.ca),
                                    FileAccess::kOwnerOnly);
  }
  return written;
}

Result<Child> NatsServer::launch(double seconds) const {
  const auto patience = std::chrono::duration_cast<steady_clock::duration>(std::chrono::duration<double>(seconds));
  const auto deadline = steady_clock::now() + patience;
  Result<Child> child =
      Child::start({options_.program, {"-c", (options_.folder / "nats-server.conf").string()}, options_.log});
  if (!child) return child;
  if (Result<void> ready = wait_until_ready(*child, deadline); !ready) return tl::unexpected(ready.error());
  return child;
}

Result<void> NatsServer::start() {
  Result<Child> child = launch();
  if (!child) return tl::unexpected(child.error());
  child_ = std::move(*child);
  return {};
}

Result<void> NatsServer::wait_until_ready(Child& child, steady_clock::time_point deadline) const {
  const std::string log = options_.log.string();
  while (!greets(config_.port, deadline)) {
    if (const auto end = child.wait(steady_clock::now() + 20ms)) {
      return fail(ErrorKind::kUnavailable, fmt::format("nats-server {}; its log {} says why", to_string(*end), log));
    }
    if (steady_clock::now() >= deadline) {
      return fail(ErrorKind::kUnavailable, fmt::format("nats-server does not answer on {}; see its log {}", url_, log));
    }
  }
  return {};
}

void NatsServer::stop(double seconds) {
  if (!child_) return;
  child_->signal(SIGCONT);
  child_->signal(SIGTERM);
  [[maybe_unused]] const auto end = child_->wait(
      steady_clock::now() + std::chrono::duration_cast<steady_clock::duration>(std::chrono::duration<double>(seconds)));
  child_.reset();
}

}  // namespace pf
