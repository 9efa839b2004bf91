#pragma once

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>

namespace pf::test {

/// A connection to a server on loopback that sends what it is told, well-formed or not. Every wait ends after
/// ten seconds.
class RawConnection {
 public:
  explicit RawConnection(const std::string& url) {
    ::sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(url.substr(url.rfind(':') + 1))));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (::connect(fd_, reinterpret_cast<const ::sockaddr*>(&address), sizeof address) != 0) {
      ::close(fd_);
      throw std::runtime_error("cannot connect to " + url);
    }
  }
  ~RawConnection() { ::close(fd_); }
  RawConnection(const RawConnection&) = delete;
  RawConnection& operator=(const RawConnection&) = delete;

  [[nodiscard]] int descriptor() const { return fd_; }
  /// False when the other side has closed.
  bool send(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t sent = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (sent <= 0) return false;
      bytes.remove_prefix(static_cast<std::size_t>(sent));
    }
    return true;
  }
  /// Everything up to the end, or up to and with `end`.
  std::string receive(std::string_view end = {}) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    while (end.empty() || received_.find(end) == std::string::npos) {
      ::pollfd poll{fd_, POLLIN, 0};
      if (std::chrono::steady_clock::now() > deadline || ::poll(&poll, 1, 10000) <= 0)
        throw std::runtime_error("no answer");
      char buffer[65536];
      const ssize_t got = ::recv(fd_, buffer, sizeof buffer, 0);
      if (got <= 0) break;
      received_.append(buffer, static_cast<std::size_t>(got));
    }
    return received_;
  }

 private:
  int fd_ = -1;
  std::string received_;
};

struct RawReply {
  int status = 0;
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;
};

inline RawReply parse_reply(const std::string& text) {
  RawReply reply;
  const std::size_t head_end = text.find("\r\n\r\n");
  if (head_end == std::string::npos || text.size() < 12) throw std::runtime_error("no HTTP reply: " + text);
  reply.status = std::stoi(text.substr(9, 3));
  for (std::size_t at = text.find("\r\n") + 2; at < head_end;) {
    const std::size_t end = text.find("\r\n", at), colon = text.find(": ", at);
    std::string name = text.substr(at, colon - at);
    std::ranges::transform(name, name.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    reply.headers[name] = text.substr(colon + 2, end - colon - 2);
    at = end + 2;
  }
  reply.body = text.substr(head_end + 4);
  if (reply.headers["transfer-encoding"] != "chunked") return reply;
  std::string whole;
  for (std::size_t at = 0; at < reply.body.size();) {
    const std::size_t line = reply.body.find("\r\n", at);
    if (line == std::string::npos) break;
    const std::size_t bytes = std::stoul(reply.body.substr(at, line - at), nullptr, 16);
    whole += reply.body.substr(line + 2, bytes);
    at = line + 2 + bytes + 2;
    if (bytes == 0) break;
  }
  reply.body = whole;
  return reply;
}

}  // namespace pf::test
