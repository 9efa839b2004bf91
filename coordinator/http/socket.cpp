#include "coordinator/http/socket.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <utility>

#include "coordinator/http/json.h"
#include "coordinator/http/tls.h"

namespace pf {
namespace {

constexpr double kSliceSeconds = 0.1;  // how late a stop may be noticed

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

int milliseconds(double seconds) { return static_cast<int>(std::ceil(std::max(seconds, 0.0) * 1000.0)); }

}  // namespace

void HttpSocket::FreeTls::operator()(::ssl_st* tls) const { SSL_free(tls); }

HttpSocket::HttpSocket(int fd, const HttpLimits& limits, std::stop_token stop, const TlsContext* tls)
    : fd_(fd), limits_(limits), stop_(std::move(stop)) {
  ::fcntl(fd_, F_SETFD, FD_CLOEXEC);
  if (tls == nullptr) return;
  ::fcntl(fd_, F_SETFL, ::fcntl(fd_, F_GETFL) | O_NONBLOCK);
  tls_.reset(SSL_new(tls->get()));
  if (!tls_ || SSL_set_fd(tls_.get(), fd_) != 1) {
    broken_ = true;
    return;
  }
  SSL_set_accept_state(tls_.get());  // the first read or write shakes hands
}

HttpSocket::~HttpSocket() { ::close(fd_); }

ssize_t HttpSocket::tls_outcome(int result, short& wanted) {
  if (result > 0) return result;
  switch (SSL_get_error(tls_.get(), result)) {
    case SSL_ERROR_WANT_READ:
      wanted = POLLIN;
      return -1;
    case SSL_ERROR_WANT_WRITE:
      wanted = POLLOUT;
      return -1;
    case SSL_ERROR_ZERO_RETURN:
      return 0;
    default:
      ERR_clear_error();
      return -1;
  }
}

ssize_t HttpSocket::receive_now(char* bytes, std::size_t count, short& wanted) {
  wanted = 0;
  if (tls_) return tls_outcome(SSL_read(tls_.get(), bytes, static_cast<int>(count)), wanted);
  ssize_t got = -1;
  do got = ::recv(fd_, bytes, count, MSG_DONTWAIT);
  while (got < 0 && errno == EINTR);
  if (got < 0 && errno == EAGAIN) wanted = POLLIN;
  return got;
}

ssize_t HttpSocket::send_now(const char* bytes, std::size_t count, short& wanted) {
  constexpr std::size_t kMostAtOnce = 1 << 20;
  wanted = 0;
  if (tls_) return tls_outcome(SSL_write(tls_.get(), bytes, static_cast<int>(std::min(count, kMostAtOnce))), wanted);
  ssize_t sent = -1;
  do sent = ::send(fd_, bytes, count, MSG_NOSIGNAL | MSG_DONTWAIT);
  while (sent < 0 && errno == EINTR);
  if (sent < 0 && errno == EAGAIN) wanted = POLLOUT;
  return sent;
}

HttpSocket::Waited HttpSocket::wait(short events, double seconds) {
  const double end = seconds_now() + seconds;
  while (true) {
    // What is ready is taken even after a stop: a short reply still gets out.
    const bool stopping = stop_.stop_requested();
    const double left = end - seconds_now();
    ::pollfd poll{fd_, events, 0};
    const int ready = ::poll(&poll, 1, stopping ? 0 : milliseconds(std::min(left, kSliceSeconds)));
    if (ready > 0) return (poll.revents & (events | POLLHUP)) != 0 ? Waited::kReady : Waited::kBroken;
    if (ready < 0 && errno != EINTR) return Waited::kBroken;
    if (stopping) return Waited::kBroken;
    if (left <= 0) return Waited::kTimeout;
  }
}

bool HttpSocket::too_slow(double waited, std::uint64_t bytes) const {
  return waited > limits_.stall_seconds + static_cast<double>(bytes) / limits_.least_bytes_per_second;
}

ssize_t HttpSocket::receive() {
  while (true) {
    short wanted = 0;
    const ssize_t got = receive_now(buffer_.data(), buffer_.size(), wanted);
    if (wanted == 0) {
      broken_ = got < 0;
      return got;
    }
    const double from = seconds_now();
    const double patience = in_head_ ? limits_.head_seconds - read_waited_ : limits_.stall_seconds;
    const Waited waited = wait(wanted, patience);
    read_waited_ += seconds_now() - from;
    const bool slow = in_head_ ? read_waited_ > limits_.head_seconds : too_slow(read_waited_, read_bytes_);
    if (waited == Waited::kTimeout || slow) {
      refuse(408, "request-timeout", "the request came too slowly");
      return -1;
    }
    if (waited == Waited::kBroken) {
      broken_ = true;
      return -1;
    }
  }
}

ssize_t HttpSocket::read(char* bytes, std::size_t count) {
  if (broken_) return -1;
  if (taken_ == buffered_) {
    const ssize_t got = receive();
    if (got <= 0) return got;
    taken_ = 0;
    buffered_ = static_cast<std::size_t>(got);
    read_bytes_ += buffered_;
  }
  const std::size_t given = std::min(count, buffered_ - taken_);
  for (std::size_t i = 0; i < given && in_head_; ++i) {
    if (!count_head(buffer_[taken_ + i])) {
      refuse(431, "head-too-large",
             fmt::format("expected lines of at most {} bytes, {} bytes with all headers", limits_.line_bytes,
                         limits_.head_bytes));
      return -1;
    }
  }
  std::copy_n(buffer_.data() + taken_, given, bytes);
  taken_ += given;
  return static_cast<ssize_t>(given);
}

bool HttpSocket::count_head(char c) {
  ++head_;
  ++line_;
  if (c == '\n') {
    if (line_ <= 2 && head_ > 2) {  // an empty line: the body begins, with a time of its own
      in_head_ = false;
      read_waited_ = 0;
      read_bytes_ = 0;
      return true;
    }
    line_ = 0;
  }
  return head_ <= limits_.head_bytes && line_ <= limits_.line_bytes;
}

ssize_t HttpSocket::write(const char* bytes, std::size_t count) {
  std::size_t done = 0;
  while (done < count) {
    if (broken_) return -1;
    short wanted = 0;
    const ssize_t sent = send_now(bytes + done, count - done, wanted);
    if (wanted != 0) {
      const double from = seconds_now();
      const Waited waited = wait(wanted, limits_.stall_seconds);
      write_waited_ += seconds_now() - from;
      broken_ = waited != Waited::kReady || too_slow(write_waited_, written_bytes_);
      continue;
    }
    if (sent <= 0) {
      broken_ = true;
      return -1;
    }
    done += static_cast<std::size_t>(sent);
    written_bytes_ += static_cast<std::uint64_t>(sent);
  }
  return static_cast<ssize_t>(count);
}

bool HttpSocket::peer_gone() const {
  if (broken_) return true;
  ::pollfd poll{fd_, POLLRDHUP, 0};
  return ::poll(&poll, 1, 0) > 0;
}

void HttpSocket::refuse(int status, std::string_view type, std::string_view detail) {
  if (tls_ && SSL_is_init_finished(tls_.get()) == 0) {  // who does not shake hands cannot be told
    broken_ = true;
    return;
  }
  const std::string body = problem_json(status, type, detail);
  const std::string reply = fmt::format(
      "HTTP/1.1 {} {}\r\nConnection: close\r\nContent-Type: application/problem+json\r\nContent-Length: {}\r\n\r\n{}",
      status, status_title(status), body.size(), body);
  static_cast<void>(write(reply.data(), reply.size()));
  broken_ = true;
}

void HttpSocket::finish() {
  if (tls_ && !broken_) {
    static_cast<void>(SSL_shutdown(tls_.get()));  // says that the reply was whole
    ERR_clear_error();
  }
  ::shutdown(fd_, SHUT_WR);
  const double end = seconds_now() + limits_.linger_seconds;
  while (seconds_now() < end && wait(POLLIN, end - seconds_now()) == Waited::kReady) {
    const ssize_t got = ::recv(fd_, buffer_.data(), buffer_.size(), MSG_DONTWAIT);
    if (got == 0 || (got < 0 && errno != EINTR && errno != EAGAIN)) return;
  }
}

}  // namespace pf
