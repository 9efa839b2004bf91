#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "common/base/result.h"

namespace pf {

/// SHA-256 of bytes that come in pieces; for what names content (scenes, specs, results).
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void update(std::string_view bytes);
  void update(std::span<const std::byte> bytes);
  /// The 64 lower-case hexadecimal digits of what came so far; more may follow.
  [[nodiscard]] std::string hex() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

[[nodiscard]] std::string sha256_hex(std::string_view bytes);
[[nodiscard]] std::string sha256_hex(std::span<const std::byte> bytes);
/// SHA-256 of a regular file's content, read in pieces. Errors: kInvalidInput.
[[nodiscard]] Result<std::string> sha256_hex_of_file(const std::filesystem::path& file);

struct Hash128 {
  std::uint64_t low = 0;
  std::uint64_t high = 0;
  friend bool operator==(const Hash128&, const Hash128&) = default;
  /// 32 lower-case hexadecimal digits, the high half first (the canonical form of xxHash).
  [[nodiscard]] std::string hex() const;
};

/// XXH3: fast and not cryptographic; for checksums and for finding equal things, never against an adversary.
[[nodiscard]] std::uint64_t xxh3_64(std::string_view bytes);
[[nodiscard]] std::uint64_t xxh3_64(std::span<const std::byte> bytes);
[[nodiscard]] Hash128 xxh3_128(std::string_view bytes);
[[nodiscard]] Hash128 xxh3_128(std::span<const std::byte> bytes);

}  // namespace pf
