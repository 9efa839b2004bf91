#pragma once

#include <cmath>

#include "common/math/vec.h"

namespace pf {

/// Largest float below one.
inline constexpr float kOneMinusEpsilon = 0x1.fffffep-1f;

/// Concentric map of the unit square to the unit disc [Shirley and Chiu 1997].
[[nodiscard]] inline Vec2f sample_disk(const Vec2f& u) {
  const float x = 2.0f * u.x - 1.0f;
  const float y = 2.0f * u.y - 1.0f;
  if (x == 0.0f && y == 0.0f) return {0.0f, 0.0f};
  const bool wide = std::abs(x) > std::abs(y);
  const float r = wide ? x : y;
  const float theta = wide ? (kPi / 4.0f) * (y / x) : (kPi / 2.0f) - (kPi / 4.0f) * (x / y);
  return {r * std::cos(theta), r * std::sin(theta)};
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
