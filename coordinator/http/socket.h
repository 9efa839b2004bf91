#pragma once

#include <sys/types.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <stop_token>
#include <string_view>

namespace pf {

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
  /// Takes the descriptor over.
  HttpSocket(int fd, const HttpLimits& limits, std::stop_token stop);
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
  [[nodiscard]] Waited wait(short events, double seconds);
  /// Passes a byte of the head; false when that breaks a limit.
  [[nodiscard]] bool count_head(char c);
  [[nodiscard]] bool too_slow(double waited, std::uint64_t bytes) const;
  /// Answers without the library's help, then reads and writes nothing more.
  void refuse(std::string_view status);

  int fd_;
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
