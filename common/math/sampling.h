#pragma once

#include <immintrin.h>

#include <array>
#include <cmath>

#include "common/math/vec.h"

namespace pf {

/// Largest float below one.
inline constexpr float kOneMinusEpsilon = 0x1.fffffep-1f;

/// `a` where `condition` holds, else `b`, without a branch: on random numbers a processor would mispredict every other
/// one.
[[nodiscard]] inline float choose(bool condition, float a, float b) {
  const __m128 mask = _mm_castsi128_ps(_mm_cvtsi32_si128(-static_cast<int>(condition)));
  return _mm_cvtss_f32(_mm_blendv_ps(_mm_set_ss(b), _mm_set_ss(a), mask));
}

/// Coefficients of glibc's sincosf (2.28 and later), for angles of at most pi/4.
inline constexpr std::array kSine = {-0x1.994eb3774cf24p-13, 0x1.1107605230bc4p-7, -0x1.555545995a603p-3};
inline constexpr std::array kCosine = {0x1.99343027bf8c3p-16, -0x1.6c087e89a359dp-10, 0x1.55553e1068f19p-5,
                                       -0x1.ffffffd0c621cp-2};
inline constexpr double kQuarterTurn = 0x1.921FB54442D18p0;  ///< pi/2

/// Concentric map of the unit square to the unit disc [Shirley and Chiu 1997].
///
/// Every diffuse bounce draws from it, so it has no branch that chance decides. Sine and cosine are the polynomials of
/// glibc's sincosf (2.28 and later, with FMA): the same floats, and the same whatever libm is installed.
[[nodiscard]] inline Vec2f sample_disk(const Vec2f& u) {
  const float x = 2.0f * u.x - 1.0f;
  const float y = 2.0f * u.y - 1.0f;
  if (x == 0.0f && y == 0.0f) return {0.0f, 0.0f};
  const bool wide = std::abs(x) > std::abs(y);
  const float r = choose(wide, x, y);
  const float across = choose(wide, y, x) / r;
  // theta is in [-pi/4, pi/4] if wide, else in [pi/4, 3 pi/4]; then a quarter turn is taken off, and sine and cosine
  // change places.
  const float theta = choose(wide, 0.0f, kPi / 2.0f) + choose(wide, kPi / 4.0f, -kPi / 4.0f) * across;
  const double v = static_cast<double>(choose(wide, theta, -theta)) + (wide ? 0.0 : kQuarterTurn);
  const double v2 = v * v, v3 = v2 * v, v4 = v2 * v2;
  const double odd = std::fma(v3 * v2, std::fma(v2, kSine[0], kSine[1]), std::fma(v3, kSine[2], v));
  const double even =
      std::fma(v4 * v2, std::fma(v2, kCosine[0], kCosine[1]), std::fma(v4, kCosine[2], std::fma(v2, kCosine[3], 1.0)));
  const float at_odd = r * static_cast<float>(odd), at_even = r * static_cast<float>(even);
  return {choose(wide, at_even, at_odd), choose(wide, at_odd, at_even)};
}

/// Cosine-weighted direction on the upper hemisphere (local frame), pdf_w = z / pi.
[[nodiscard]] inline Vec3f sample_cosine_hemisphere(const Vec2f& u) {
  const Vec2f d = sample_disk(u);
  return {d.x, d.y, std::sqrt(std::max(0.0f, 1.0f - d.x * d.x - d.y * d.y))};
}

/// Uniform direction on the sphere, pdf_w = 1 / (4 pi).
[[nodiscard]] inline Vec3f sample_sphere(const Vec2f& u) {
  const float z = 1.0f - 2.0f * u.x;
  const float r = std::sqrt(std::max(0.0f, 1.0f - z * z));
  const float phi = 2.0f * kPi * u.y;
  return {r * std::cos(phi), r * std::sin(phi), z};
}

/// Uniform direction in the cone of `cos_max` around local z, pdf_w = 1 / (2 pi (1 - cos_max)).
[[nodiscard]] inline Vec3f sample_cone(const Vec2f& u, float cos_max) {
  const float z = 1.0f - u.x * (1.0f - cos_max);
  const float r = std::sqrt(std::max(0.0f, 1.0f - z * z));
  const float phi = 2.0f * kPi * u.y;
  return {r * std::cos(phi), r * std::sin(phi), z};
}

/// Uniform barycentric coordinates (b1, b2) of a triangle [Heitz 2019, "A Low-Distortion Map Between Triangle and
/// Square"].
[[nodiscard]] inline Vec2f sample_triangle(const Vec2f& u) {
  Vec2f b = u;
  if (u.y > u.x) {
    b.x *= 0.5f;
    b.y -= b.x;
  } else {
    b.y *= 0.5f;
    b.x -= b.y;
  }
  return b;
}

/// Power heuristic with exponent 2 for one sample of each of two techniques [Veach 1997, section 9.2.4].
[[nodiscard]] inline float power_heuristic(float pdf_a, float pdf_b) {
  if (std::isinf(pdf_a)) return 1.0f;
  const float a = pdf_a * pdf_a;
  const float b = pdf_b * pdf_b;
  return a + b > 0.0f ? a / (a + b) : 0.0f;
}

}  // namespace pf
