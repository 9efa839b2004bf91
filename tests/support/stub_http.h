#pragma once

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <functional>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace pf::test {

struct StubRequest {
  std::string method, path, head, body;
};
struct StubReply {
  int status = 200;
  std::string body = "{}";
};

/// A server on loopback that answers what the test says, one connection after the other, and remembers what
/// it was asked.
class StubServer {
 public:
  explicit StubServer(std::function<StubReply(const StubRequest&)> answer) : answer_(std::move(answer)) {
    fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    ::sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ::socklen_t size = sizeof address;
    if (::bind(fd_, reinterpret_cast<::sockaddr*>(&address), sizeof address) != 0 || ::listen(fd_, 64) != 0 ||
        ::getsockname(fd_, reinterpret_cast<::sockaddr*>(&address), &size) != 0)
      throw std::runtime_error("cannot listen");
    url_ = "http://127.0.0.1:" + std::to_string(ntohs(address.sin_port));
    thread_ = std::thread([this] { serve(); });
  }
  ~StubServer() {
    stopping_ = true;
    thread_.join();
    ::close(fd_);
  }
  StubServer(const StubServer&) = delete;
  StubServer& operator=(const StubServer&) = delete;

  [[nodiscard]] const std::string& url() const { return url_; }
  [[nodiscard]] std::vector<StubRequest> requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
  }

 private:
  void serve() {
    while (!stopping_) {
      ::pollfd poll{fd_, POLLIN, 0};
      if (::poll(&poll, 1, 20) <= 0) continue;
      const int connection = ::accept4(fd_, nullptr, nullptr, SOCK_CLOEXEC);
      if (connection < 0) continue;
      answer(connection);
      ::close(connection);
    }
  }
  void answer(int connection) {
    std::string text;
    std::size_t whole = std::string::npos;
    while (text.size() < whole) {
      char buffer[4096];
      const ssize_t got = ::recv(connection, buffer, sizeof buffer, 0);
      if (got <= 0) return;
      text.append(buffer, static_cast<std::size_t>(got));
      const std::size_t head = text.find("\r\n\r\n");
      if (head == std::string::npos || whole != std::string::npos) continue;
      const std::size_t length = text.find("Content-Length: ");
      whole = head + 4 + (length < head ? std::stoul(text.substr(length + 16)) : 0);
    }
    const std::size_t head = text.find("\r\n\r\n"), space = text.find(' ');
    const StubRequest request{text.substr(0, space), text.substr(space + 1, text.find(' ', space + 1) - space - 1),
                              text.substr(0, head), text.substr(head + 4)};
    {
      const std::lock_guard lock(mutex_);
      requests_.push_back(request);
    }
    const StubReply reply = answer_(request);
    const std::string sent = "HTTP/1.1 " + std::to_string(reply.status) +
                             " X\r\nConnection: close\r\nContent-Type: application/json\r\n" +
                             "Content-Length: " + std::to_string(reply.body.size()) + "\r\n\r\n" + reply.body;
    static_cast<void>(::send(connection, sent.data(), sent.size(), MSG_NOSIGNAL));
  }

  const std::function<StubReply(const StubRequest&)> answer_;
  int fd_ = -1;
  std::string url_;
  mutable std::mutex mutex_;
  std::vector<StubRequest> requests_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace pf::test
