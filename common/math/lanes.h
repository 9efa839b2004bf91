#pragma once

#include <immintrin.h>

#include <array>
#include <bit>
#include <cstdint>

#include "common/math/vec.h"

namespace pf {

/// Eight values side by side, with the operators of one: the same operations in the same order give, in every lane, the
/// bits that they give for one value alone. A comparison's lanes are all ones where it holds; `mask ? a : b` chooses
/// lane by lane.
using Float8 [[gnu::vector_size(32)]] = float;
using Int8 [[gnu::vector_size(32)]] = std::int32_t;
using Uint8 [[gnu::vector_size(32)]] = std::uint32_t;

inline constexpr int kLanes = 8;
inline constexpr unsigned kAllLanes = 0xFF;

[[nodiscard]] inline Float8 all(float x) { return _mm256_set1_ps(x); }
[[nodiscard]] inline Float8 sqrt(const Float8& x) { return _mm256_sqrt_ps(x); }
[[nodiscard]] inline Float8 abs(const Float8& x) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), x); }
/// `magnitude` (not negative) with the sign of `sign`.
[[nodiscard]] inline Float8 with_sign(const Float8& magnitude, const Float8& sign) {
  return _mm256_or_ps(magnitude, _mm256_and_ps(sign, _mm256_set1_ps(-0.0f)));
}
/// As std::max and std::min, NaN included.
[[nodiscard]] inline Float8 max(const Float8& a, const Float8& b) { return _mm256_max_ps(b, a); }
[[nodiscard]] inline Float8 min(const Float8& a, const Float8& b) { return _mm256_min_ps(b, a); }
/// As std::lrint in the default rounding mode.
[[nodiscard]] inline Uint8 round_to_int(const Float8& x) { return reinterpret_cast<Uint8>(_mm256_cvtps_epi32(x)); }

/// Bit i: lane i of a comparison holds.
[[nodiscard]] inline unsigned lanes_of(const Int8& mask) {
  return static_cast<unsigned>(_mm256_movemask_ps(reinterpret_cast<__m256>(mask)));
}
[[nodiscard]] inline Int8 mask_of(unsigned lanes) {
  const Int8 bit = {1, 2, 4, 8, 16, 32, 64, 128};
  return (bit & static_cast<std::int32_t>(lanes)) != 0;
}
/// Calls f(lane) for every bit that is set.
template <typename F>
void for_each_lane(unsigned lanes, F&& f) {
  for (; lanes != 0; lanes &= lanes - 1) f(static_cast<std::size_t>(std::countr_zero(lanes)));
}

/// Eight vectors.
struct Vec3x8 {
  Float8 x, y, z;

  [[nodiscard]] Vec3f operator[](std::size_t lane) const { return {x[lane], y[lane], z[lane]}; }
  void set(std::size_t lane, const Vec3f& v) { x[lane] = v.x, y[lane] = v.y, z[lane] = v.z; }
  Vec3x8 operator+(const Vec3x8& b) const { return {x + b.x, y + b.y, z + b.z}; }
  Vec3x8 operator-(const Vec3x8& b) const { return {x - b.x, y - b.y, z - b.z}; }
  Vec3x8 operator*(const Vec3x8& b) const { return {x * b.x, y * b.y, z * b.z}; }
  Vec3x8 operator*(const Float8& s) const { return {x * s, y * s, z * s}; }
  Vec3x8 operator/(const Float8& s) const { return {x / s, y / s, z / s}; }
  Vec3x8 operator-() const { return {-x, -y, -z}; }
  [[nodiscard]] Int8 operator==(const Vec3x8& b) const { return (x == b.x) & (y == b.y) & (z == b.z); }
};

[[nodiscard]] inline Vec3x8 all(const Vec3f& v) { return {all(v.x), all(v.y), all(v.z)}; }
[[nodiscard]] inline Float8 dot(const Vec3x8& a, const Vec3x8& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
[[nodiscard]] inline Float8 length2(const Vec3x8& v) { return dot(v, v); }
[[nodiscard]] inline Vec3x8 normalize(const Vec3x8& v) { return v * (1.0f / sqrt(dot(v, v))); }
[[nodiscard]] inline Float8 max_component(const Vec3x8& c) { return max(c.x, max(c.y, c.z)); }
[[nodiscard]] inline Float8 average(const Vec3x8& c) { return (c.x + c.y + c.z) * (1.0f / 3.0f); }
[[nodiscard]] inline Vec3x8 select(const Int8& mask, const Vec3x8& a, const Vec3x8& b) {
  return {mask ? a.x : b.x, mask ? a.y : b.y, mask ? a.z : b.z};
}

/// Rows become columns: element i of the result's k-th is element k of the i-th.
inline void transpose(std::array<Float8, 8>& rows) {
  std::array<Float8, 8> pairs, quads;
  for (std::size_t i = 0; i < 8; i += 2) {
    pairs[i] = _mm256_unpacklo_ps(rows[i], rows[i + 1]);
    pairs[i + 1] = _mm256_unpackhi_ps(rows[i], rows[i + 1]);
  }
  for (std::size_t i = 0; i < 8; i += 4) {
    quads[i] = _mm256_shuffle_ps(pairs[i], pairs[i + 2], 0x44);
    quads[i + 1] = _mm256_shuffle_ps(pairs[i], pairs[i + 2], 0xEE);
    quads[i + 2] = _mm256_shuffle_ps(pairs[i + 1], pairs[i + 3], 0x44);
    quads[i + 3] = _mm256_shuffle_ps(pairs[i + 1], pairs[i + 3], 0xEE);
  }
  for (std::size_t i = 0; i < 4; ++i) {
    rows[i] = _mm256_permute2f128_ps(quads[i], quads[i + 4], 0x20);
    rows[i + 4] = _mm256_permute2f128_ps(quads[i], quads[i + 4], 0x31);
  }
}

}  // namespace pf
