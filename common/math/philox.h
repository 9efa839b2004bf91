#pragma once

#include <array>
#include <cstdint>

#include "common/math/vec.h"

namespace pf {

/// Philox 4x32-10: a pure function from a 128-bit counter and a 64-bit key to 128 random bits
/// [Salmon et al. 2011, "Parallel Random Numbers: As Easy as 1, 2, 3", section 3.3].
[[nodiscard]] inline std::array<std::uint32_t, 4> philox4x32(std::array<std::uint32_t, 4> counter,
                                                             std::array<std::uint32_t, 2> key) {
  constexpr std::uint32_t kMultiplier0 = 0xD2511F53u, kMultiplier1 = 0xCD9E8D57u;
  constexpr std::uint32_t kWeyl0 = 0x9E3779B9u, kWeyl1 = 0xBB67AE85u;
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t product0 = std::uint64_t{kMultiplier0} * counter[0];
    const std::uint64_t product1 = std::uint64_t{kMultiplier1} * counter[2];
    counter = {static_cast<std::uint32_t>(product1 >> 32) ^ counter[1] ^ key[0], static_cast<std::uint32_t>(product1),
               static_cast<std::uint32_t>(product0 >> 32) ^ counter[3] ^ key[1], static_cast<std::uint32_t>(product0)};
    key[0] += kWeyl0;
    key[1] += kWeyl1;
  }
  return counter;
}

/// Uniform float in [0, 1) from 32 random bits (24 of them are used).
[[nodiscard]] inline float to_unit_float(std::uint32_t bits) { return static_cast<float>(bits >> 8) * 0x1p-24f; }

/// What a stream of random numbers is for; part of the counter, so that streams never share numbers.
enum class Stream : std::uint32_t { kPhoton = 1, kEye = 2, kProbe = 3, kTest = 100 };

/// Random numbers of one path: a pure function of (job seed, stream, sub-pass, path index, dimension).
class PathRng {
 public:
  PathRng(std::uint64_t seed, Stream stream, std::uint64_t sub_pass, std::uint32_t path)
      : key_{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)},
        // 12 bits of dimension blocks (16384 numbers a path), 40 bits of sub-pass, stream in the high word.
        counter_{path, static_cast<std::uint32_t>(sub_pass),
                 static_cast<std::uint32_t>(sub_pass >> 32) ^ (static_cast<std::uint32_t>(stream) << 16), 0} {}

  [[nodiscard]] float next1() {
    if (used_ == 4) refill();
    return to_unit_float(block_[used_++]);
  }
  [[nodiscard]] Vec2f next2() {
    const float x = next1();
    return {x, next1()};
  }

 private:
  void refill() {
    block_ = philox4x32(counter_, key_);
    ++counter_[3];
    used_ = 0;
  }
  std::array<std::uint32_t, 2> key_;
  std::array<std::uint32_t, 4> counter_;
  std::array<std::uint32_t, 4> block_{};
  unsigned used_ = 4;
};

}  // namespace pf
