#pragma once

#include <sys/types.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <stop_token>
#include <string_view>

struct ssl_st;

namespace pf {

class TlsContext;

/// What one connection may cost. Seconds count only while waiting for the other side.
struct HttpLimits {
  std::size_t head_bytes = 16384;        ///< request line and headers
  std::size_t line_bytes = 4096;         ///< each of them
  double head_seconds = 10;              ///< for all of them to come
  double stall_seconds = 30;             ///< of waiting that a body or reply may cost beyond ...
  double least_bytes_per_second = 1024;  ///< ... what this rate explains
  double linger_seconds = 1;             ///< for the other side to close after the reply
};

/// One accepted connection that serves one request. The HTTP library reads headers of any size and waits anew
/// for every byte; here heads are bounded, slow peers are cut off, and waiting ends when the server stops.
class HttpSocket {
 public:
  /// Takes the descriptor over. `tls`: nullptr for plain HTTP; the handshake counts as part of the head.
  HttpSocket(int fd, const HttpLimits& limits, std::stop_token stop, const TlsContext* tls = nullptr);
  HttpSocket(const HttpSocket&) = delete;
  HttpSocket& operator=(const HttpSocket&) = delete;
  ~HttpSocket();

  /// As recv and send with blocking, all bytes for write; -1 after a breach of the limits, a broken
  /// connection or a stop.
  [[nodiscard]] ssize_t read(char* bytes, std::size_t count);
  [[nodiscard]] ssize_t write(const char* bytes, std::size_t count);
  /// True when nobody reads any more what would be written.
  [[nodiscard]] bool peer_gone() const;
  /// Ends the reply and waits a little for the peer to close: closing with unread input would reset the
  /// connection, and the reply might get lost.
  void finish();
  [[nodiscard]] int descriptor() const { return fd_; }

 private:
  enum class Waited { kReady, kTimeout, kBroken };
  struct FreeTls {
    void operator()(::ssl_st* tls) const;
  };
  /// As recv and send that never block; 0 at the end of what can be read. When nothing can be done before the socket is
  /// ready, -1 and `wanted` is what to poll it for, else `wanted` is 0.
  [[nodiscard]] ssize_t receive_now(char* bytes, std::size_t count, short& wanted);
  [[nodiscard]] ssize_t send_now(const char* bytes, std::size_t count, short& wanted);
  [[nodiscard]] ssize_t tls_outcome(int result, short& wanted);
  /// Fills the buffer; as read.
  [[nodiscard]] ssize_t receive();
  [[nodiscard]] Waited wait(short events, double seconds);
  /// Passes a byte of the head; false when that breaks a limit.
  [[nodiscard]] bool count_head(char c);
  [[nodiscard]] bool too_slow(double waited, std::uint64_t bytes) const;
  /// Answers a problem document without the library's help, then reads and writes nothing more.
  void refuse(int status, std::string_view type, std::string_view detail);

  int fd_;
  std::unique_ptr<::ssl_st, FreeTls> tls_;
  const HttpLimits limits_;
  std::stop_token stop_;
  std::array<char, 16384> buffer_;
  std::size_t buffered_ = 0, taken_ = 0;
  std::size_t head_ = 0, line_ = 0;  ///< bytes so far
  bool in_head_ = true, broken_ = false;
  double read_waited_ = 0, write_waited_ = 0;
  std::uint64_t read_bytes_ = 0, written_bytes_ = 0;
};

}  // namespace pf
