#pragma once

#include "common/math/frame.h"
#include "common/math/lanes.h"
#include "common/math/offset.h"
#include "common/math/philox.h"
#include "common/math/sampling.h"

namespace pf {

/// What philox.h, sampling.h, frame.h and offset.h compute, for eight at once and to the same bits.

struct Vec2x8 {
  Float8 x, y;
};

/// philox4x32() of eight counters with one key.
[[nodiscard]] inline std::array<Uint8, 4> philox4x32(std::array<Uint8, 4> counter, std::array<std::uint32_t, 2> key) {
  const auto multiply = [](const Uint8& factor, std::uint32_t multiplier, Uint8& high, Uint8& low) {
    const __m256i m = _mm256_set1_epi64x(multiplier);
    const auto f = reinterpret_cast<__m256i>(factor);
    const __m256i even = _mm256_mul_epu32(f, m), odd = _mm256_mul_epu32(_mm256_srli_epi64(f, 32), m);
    high = reinterpret_cast<Uint8>(_mm256_blend_epi32(_mm256_srli_epi64(even, 32), odd, 0b10101010));
    low = reinterpret_cast<Uint8>(_mm256_blend_epi32(even, _mm256_slli_epi64(odd, 32), 0b10101010));
  };
  for (int round = 0; round < 10; ++round) {
    Uint8 high0, low0, high1, low1;
    multiply(counter[0], kPhiloxMultiplier0, high0, low0);
    multiply(counter[2], kPhiloxMultiplier1, high1, low1);
    counter = {high1 ^ counter[1] ^ key[0], low1, high0 ^ counter[3] ^ key[1], low0};
    key[0] += kPhiloxWeyl0;
    key[1] += kPhiloxWeyl1;
  }
  return counter;
}

[[nodiscard]] inline Float8 to_unit_float(const Uint8& bits) {
  return _mm256_cvtepi32_ps(reinterpret_cast<__m256i>(bits >> 8)) * 0x1p-24f;
}

[[nodiscard]] inline Vec2x8 sample_disk(const Vec2x8& u) {
  using Double4 [[gnu::vector_size(32)]] = double;
  const Float8 x = 2.0f * u.x - 1.0f, y = 2.0f * u.y - 1.0f;
  const Int8 wide = abs(x) > abs(y);
  const Float8 r = wide ? x : y;
  const Float8 across = (wide ? y : x) / r;
  const Float8 theta = (wide ? all(0.0f) : all(kPi / 2.0f)) + (wide ? all(kPi / 4.0f) : all(-kPi / 4.0f)) * across;
  const Float8 turned = wide ? theta : -theta;
  const auto sine_and_cosine = [](Double4 v, __m128& sine, __m128& cosine) {
    const auto fma = [](const Double4& a, const Double4& b, const Double4& c) -> Double4 {
      return _mm256_fmadd_pd(a, b, c);
    };
    const auto every = [](double c) -> Double4 { return _mm256_set1_pd(c); };
    const Double4 v2 = v * v, v3 = v2 * v, v4 = v2 * v2;
    const Double4 odd = fma(v3 * v2, fma(v2, every(kSine[0]), every(kSine[1])), fma(v3, every(kSine[2]), v));
    const Double4 even = fma(v4 * v2, fma(v2, every(kCosine[0]), every(kCosine[1])),
                             fma(v4, every(kCosine[2]), fma(v2, every(kCosine[3]), every(1.0))));
    sine = _mm256_cvtpd_ps(odd);
    cosine = _mm256_cvtpd_ps(even);
  };
  const auto quarter = [](const __m128i& is_wide) -> Double4 {
    return _mm256_andnot_pd(_mm256_castsi256_pd(_mm256_cvtepi32_epi64(is_wide)), _mm256_set1_pd(kQuarterTurn));
  };
  const auto w = reinterpret_cast<__m256i>(wide);
  __m128 sine[2], cosine[2];
  sine_and_cosine(Double4(_mm256_cvtps_pd(_mm256_castps256_ps128(turned))) + quarter(_mm256_castsi256_si128(w)),
                  sine[0], cosine[0]);
  sine_and_cosine(Double4(_mm256_cvtps_pd(_mm256_extractf128_ps(turned, 1))) + quarter(_mm256_extracti128_si256(w, 1)),
                  sine[1], cosine[1]);
  const Float8 at_odd = r * Float8(_mm256_set_m128(sine[1], sine[0])),
               at_even = r * Float8(_mm256_set_m128(cosine[1], cosine[0]));
  const Int8 centre = (x == 0.0f) & (y == 0.0f);
  return {centre ? all(0.0f) : (wide ? at_even : at_odd), centre ? all(0.0f) : (wide ? at_odd : at_even)};
}

[[nodiscard]] inline Vec3x8 sample_cosine_hemisphere(const Vec2x8& u) {
  const Vec2x8 d = sample_disk(u);
  return {d.x, d.y, sqrt(max(all(0.0f), 1.0f - d.x * d.x - d.y * d.y))};
}

/// Frames around eight normals.
struct Frame8 {
  Vec3x8 t, b, n;

  [[nodiscard]] static Frame8 from_normal(const Vec3x8& n) {
    const Float8 sign = with_sign(all(1.0f), n.z);
    const Float8 a = -1.0f / (sign + n.z);
    const Float8 c = n.x * n.y * a;
    return {{1.0f + sign * n.x * n.x * a, sign * c, -sign * n.x}, {c, sign + n.y * n.y * a, -n.y}, n};
  }
  [[nodiscard]] Vec3x8 to_local(const Vec3x8& v) const { return {dot(v, t), dot(v, b), dot(v, n)}; }
  [[nodiscard]] Vec3x8 to_world(const Vec3x8& v) const { return t * v.x + b * v.y + n * v.z; }
};

[[nodiscard]] inline Vec3x8 offset_ray_origin(const Vec3x8& p, const Vec3x8& ng, const Vec3x8& direction,
                                              const Float8& extent) {
  const Float8 magnitude = max(abs(p.x), max(abs(p.y), abs(p.z)));
  return p + ng * with_sign(kRayOffset * max(extent, magnitude), dot(direction, ng));
}

}  // namespace pf
