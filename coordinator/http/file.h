#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/result.h"

namespace pf {

/// A file held open for reading: replacing it under its name does not change what is read here.
class OpenFile {
 public:
  /// Errors: kUnavailable when it is not there or no regular file.
  [[nodiscard]] static Result<OpenFile> open(const std::filesystem::path& file);
  OpenFile(OpenFile&& other) noexcept;
  OpenFile& operator=(OpenFile&&) = delete;
  ~OpenFile();

  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  /// Changes with every replacement (inode, size, time of change), quoted as HTTP wants it.
  [[nodiscard]] const std::string& etag() const { return etag_; }
  /// At most `count` bytes from `offset`; fewer only at the end or on an error of the disk.
  [[nodiscard]] std::string read(std::uint64_t offset, std::size_t count) const;

 private:
  explicit OpenFile(int fd) : fd_(fd) {}
  int fd_;
  std::uint64_t bytes_ = 0;
  std::string etag_;
};

/// One range of bytes out of `size` (RFC 9110, 14.2).
struct ByteRange {
  enum class Kind { kWhole, kPart, kUnsatisfiable } kind = Kind::kWhole;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
};
/// What a Range header asks for. Malformed ones, other units and several ranges at once are ignored, as the
/// standard allows.
[[nodiscard]] ByteRange parse_range(std::string_view header, std::uint64_t size);

}  // namespace pf
