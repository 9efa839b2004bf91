#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <Imath/ImathBox.h>
#include <Imath/ImathMatrix.h>
#include <Imath/ImathVec.h>

namespace pf {

using Vec2f = Imath::V2f;
using Vec3f = Imath::V3f;
using Vec4f = Imath::V4f;
using Box3f = Imath::Box3f;
/// Row vectors, as everywhere in Imath: a point transforms as `p * m`; m[3] is the translation. A glTF matrix, stored
/// column after column for column vectors, has the same sixteen floats in the same order.
using Matrix44f = Imath::M44f;
/// Three linear Rec.709 channels of a radiometric quantity or of a dimensionless albedo or throughput.
using Rgb = Imath::V3f;

inline constexpr float kPi = std::numbers::pi_v<float>;
inline constexpr float kInvPi = std::numbers::inv_pi_v<float>;
inline constexpr float kInfinity = std::numeric_limits<float>::infinity();

[[nodiscard]] inline float dot(const Vec3f& a, const Vec3f& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
[[nodiscard]] inline Vec3f cross(const Vec3f& a, const Vec3f& b) { return a.cross(b); }
[[nodiscard]] inline float length2(const Vec3f& v) { return dot(v, v); }
[[nodiscard]] inline float length(const Vec3f& v) { return std::sqrt(dot(v, v)); }
[[nodiscard]] inline Vec3f normalize(const Vec3f& v) { return v * (1.0f / length(v)); }
[[nodiscard]] inline float max_component(const Rgb& c) { return std::max(c.x, std::max(c.y, c.z)); }
[[nodiscard]] inline float min_component(const Rgb& c) { return std::min(c.x, std::min(c.y, c.z)); }
[[nodiscard]] inline float average(const Rgb& c) { return (c.x + c.y + c.z) * (1.0f / 3.0f); }
/// Relative luminance of linear Rec.709 (ITU-R BT.709-6, item 3.2).
[[nodiscard]] inline float luminance(const Rgb& c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }
[[nodiscard]] inline bool is_zero(const Rgb& c) { return c.x == 0.0f && c.y == 0.0f && c.z == 0.0f; }
[[nodiscard]] inline bool is_finite(const Vec3f& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}
[[nodiscard]] inline Rgb lerp(const Rgb& a, const Rgb& b, float t) { return a * (1.0f - t) + b * t; }
[[nodiscard]] inline Rgb exp(const Rgb& v) { return {std::exp(v.x), std::exp(v.y), std::exp(v.z)}; }

}  // namespace pf
