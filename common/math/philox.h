#pragma once

#include <immintrin.h>

#include <array>
#include <cstdint>

#include "common/math/vec.h"

namespace pf {

inline constexpr std::uint32_t kPhiloxMultiplier0 = 0xD2511F53u, kPhiloxMultiplier1 = 0xCD9E8D57u;
inline constexpr std::uint32_t kPhiloxWeyl0 = 0x9E3779B9u, kPhiloxWeyl1 = 0xBB67AE85u;

/// Philox 4x32-10: a pure function from a 128-bit counter and a 64-bit key to 128 random bits
/// [Salmon et al. 2011, "Parallel Random Numbers: As Easy as 1, 2, 3", section 3.3].
[[nodiscard]] inline std::array<std::uint32_t, 4> philox4x32(std::array<std::uint32_t, 4> counter,
                                                             std::array<std::uint32_t, 2> key) {
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t product0 = std::uint64_t{kPhiloxMultiplier0} * counter[0];
    const std::uint64_t product1 = std::uint64_t{kPhiloxMultiplier1} * counter[2];
    counter = {static_cast<std::uint32_t>(product1 >> 32) ^ counter[1] ^ key[0], static_cast<std::uint32_t>(product1),
               static_cast<std::uint32_t>(product0 >> 32) ^ counter[3] ^ key[1], static_cast<std::uint32_t>(product0)};
    key[0] += kPhiloxWeyl0;
    key[1] += kPhiloxWeyl1;
  }
  return counter;
}

/// Uniform float in [0, 1) from 32 random bits (24 of them are used).
[[nodiscard]] inline float to_unit_float(std::uint32_t bits) { return static_cast<float>(bits >> 8) * 0x1p-24f; }

/// What a stream of random numbers is for; part of the counter, so that streams never share numbers.
enum class Stream : std::uint32_t { kPhoton = 1, kEye = 2, kProbe = 3, kTest = 100, kIrradiance = 101 };

/// Random numbers of one path: a pure function of (job seed, stream, sub-pass, path index, dimension).
class PathRng {
 public:
  PathRng(std::uint64_t seed, Stream stream, std::uint64_t sub_pass, std::uint32_t path)
      : key_{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)},
        // 12 bits of dimension blocks (16384 numbers a path), 40 bits of sub-pass, stream in the high word.
        counter_{path, static_cast<std::uint32_t>(sub_pass),
                 static_cast<std::uint32_t>(sub_pass >> 32) ^ (static_cast<std::uint32_t>(stream) << 16), 0} {}

  [[nodiscard]] float next1() {
    if (used_ == kBuffered) refill();
    return buffer_[used_++];
  }
  [[nodiscard]] Vec2f next2() {
    const float x = next1();
    return {x, next1()};
  }

 private:
  static constexpr unsigned kBuffered = 16;

  /// Four blocks at once, one in each 64-bit lane: about the time of one. Once for sixteen numbers: not worth a copy at
  /// every place that draws one.
  [[gnu::noinline]] void refill() {
    const auto every = [](std::uint32_t v) { return _mm256_set1_epi64x(v); };
    __m256i c0 = every(counter_[0]), c1 = every(counter_[1]), c2 = every(counter_[2]);
    __m256i c3 = _mm256_add_epi32(every(counter_[3]), _mm256_setr_epi64x(0, 1, 2, 3));
    std::uint32_t key0 = key_[0], key1 = key_[1];
    for (int round = 0; round < 10; ++round) {
      // Only the low halves of the lanes count as factors: what is left in the high ones does no harm.
      const __m256i product0 = _mm256_mul_epu32(c0, every(kPhiloxMultiplier0));
      const __m256i product1 = _mm256_mul_epu32(c2, every(kPhiloxMultiplier1));
      c0 = _mm256_xor_si256(_mm256_xor_si256(_mm256_srli_epi64(product1, 32), c1), every(key0));
      c2 = _mm256_xor_si256(_mm256_xor_si256(_mm256_srli_epi64(product0, 32), c3), every(key1));
      c1 = product1;
      c3 = product0;
      key0 += kPhiloxWeyl0;
      key1 += kPhiloxWeyl1;
    }
    // To block after block, and to_unit_float().
    const __m256i low = _mm256_blend_epi32(c0, _mm256_slli_epi64(c1, 32), 0b10101010);
    const __m256i high = _mm256_blend_epi32(c2, _mm256_slli_epi64(c3, 32), 0b10101010);
    const auto unit = [](__m256i bits) {
      return _mm256_mul_ps(_mm256_cvtepi32_ps(_mm256_srli_epi32(bits, 8)), _mm256_set1_ps(0x1p-24f));
    };
    const __m256 even = unit(_mm256_unpacklo_epi64(low, high));  // blocks 0 and 2
    const __m256 odd = unit(_mm256_unpackhi_epi64(low, high));   // blocks 1 and 3
    _mm256_storeu_ps(buffer_.data(), _mm256_permute2f128_ps(even, odd, 0x20));
    _mm256_storeu_ps(buffer_.data() + 8, _mm256_permute2f128_ps(even, odd, 0x31));
    counter_[3] += 4;
    used_ = 0;
  }

  std::array<std::uint32_t, 2> key_;
  std::array<std::uint32_t, 4> counter_;
  std::array<float, kBuffered> buffer_{};
  unsigned used_ = kBuffered;
};

}  // namespace pf
