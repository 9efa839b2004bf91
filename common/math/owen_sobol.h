#pragma once

#include <cstdint>

#include "common/math/vec.h"

namespace pf {

/// Low-discrepancy points of one pixel over its samples: Owen-scrambled Sobol points, padded: every pair of dimensions
/// is a freshly scrambled and shuffled (0,2)-sequence [Burley 2020, "Practical Hash-based Owen Scrambling"]. Stateless:
/// a pure function of (pixel seed, sample index, dimension).

[[nodiscard]] constexpr std::uint32_t reverse_bits(std::uint32_t x) {
  x = __builtin_bswap32(x);
  x = ((x & 0x0F0F0F0Fu) << 4) | ((x >> 4) & 0x0F0F0F0Fu);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  x = ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
  return x;
}

/// 32-bit finaliser with low bias ("lowbias32" of C. Wellons' hash prospector).
[[nodiscard]] constexpr std::uint32_t mix_bits(std::uint32_t x) {
  x ^= x >> 16;
  x *= 0x7FEB352Du;
  x ^= x >> 15;
  x *= 0x846CA68Bu;
  return x ^ (x >> 16);
}

[[nodiscard]] constexpr std::uint32_t combine_hash(std::uint32_t a, std::uint32_t b) {
  return mix_bits(a ^ (b + 0x9E3779B9u + (a << 6) + (a >> 2)));
}

/// Nested uniform (Owen) scramble of a bit-reversed value; constants of N. Vegdahl's improved Laine-Karras permutation.
[[nodiscard]] constexpr std::uint32_t laine_karras(std::uint32_t x, std::uint32_t seed) {
  x ^= x * 0x3D20ADEAu;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526C56u;
  x ^= x * 0x53A22864u;
  return x;
}

[[nodiscard]] constexpr std::uint32_t owen_scramble(std::uint32_t x, std::uint32_t seed) {
  return reverse_bits(laine_karras(reverse_bits(x), seed));
}

/// Second Sobol dimension, as a 32-bit fraction (the first is reverse_bits of the index).
[[nodiscard]] constexpr std::uint32_t sobol1(std::uint32_t index) {
  // The direction numbers v_k = v_{k-1} ^ (v_{k-1} >> 1) are Pascal's triangle mod 2: the index, read as a polynomial
  // p(x) over GF(2), becomes p(1 + x). Because (1 + x)^h = 1 + x^h for h a power of two, that takes five steps.
  std::uint32_t x = index;
  x ^= (x & 0xAAAAAAAAu) >> 1;
  x ^= (x & 0xCCCCCCCCu) >> 2;
  x ^= (x & 0xF0F0F0F0u) >> 4;
  x ^= (x & 0xFF00FF00u) >> 8;
  x ^= (x & 0xFFFF0000u) >> 16;
  return reverse_bits(x);
}

class PixelSequence {
 public:
  /// `pixel_seed` must differ from pixel to pixel (hash of seed and pixel index); `sample` counts over the whole job.
  PixelSequence(std::uint32_t pixel_seed, std::uint32_t sample) : seed_(pixel_seed), sample_(sample) {}

  [[nodiscard]] float next1() {
    const std::uint32_t h = combine_hash(seed_, dimension_++);
    const std::uint32_t i = owen_scramble(sample_, h);
    return to_float(owen_scramble(reverse_bits(i), mix_bits(h ^ 0xA511E9B3u)));
  }
  [[nodiscard]] Vec2f next2() {
    const std::uint32_t h = combine_hash(seed_, dimension_++);
    const std::uint32_t i = owen_scramble(sample_, h);
    const std::uint32_t x = owen_scramble(reverse_bits(i), mix_bits(h ^ 0xA511E9B3u));
    const std::uint32_t y = owen_scramble(sobol1(i), mix_bits(h ^ 0x63D83595u));
    return {to_float(x), to_float(y)};
  }

 private:
  [[nodiscard]] static float to_float(std::uint32_t bits) { return static_cast<float>(bits >> 8) * 0x1p-24f; }
  std::uint32_t seed_;
  std::uint32_t sample_;
  std::uint32_t dimension_ = 0;
};

}  // namespace pf
