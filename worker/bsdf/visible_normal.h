#pragma once

#include <algorithm>

#include "common/math/vec.h"

namespace pf {

/// Smallest cosine, to shading and geometric normals, that turned shading normals leave.
inline constexpr float kMinNormalTurn = 0.01f;

[[nodiscard]] inline bool is_unit(const Vec3f& v) {
  const float l = length2(v);
  return l > 0.98f && l < 1.02f;
}

[[nodiscard]] inline float view_limit(const Vec3f& ng, const Vec3f& wo) {
  return std::min(kMinNormalTurn, 0.9f * dot(wo, ng));
}

/// Turns `n` towards wo just far enough that wo sees it from above.
[[nodiscard]] inline Vec3f turn_into_view(const Vec3f& n, const Vec3f& wo, float limit) {
  const float cosine = dot(wo, n);
  return cosine >= limit ? n : normalize(n + wo * (limit - cosine));
}

/// `n` of the mesh's front side, turned to wo's side and to where wo sees it from above. `ng` is on wo's side.
[[nodiscard]] inline Vec3f visible_normal(const Vec3f& n, bool front, const Vec3f& ng, const Vec3f& wo) {
  const Vec3f turned = front ? n : -n;
  if (turned == ng || !is_unit(n) || !(dot(turned, ng) > 0.0f)) return ng;
  const Vec3f visible = turn_into_view(turned, wo, view_limit(ng, wo));
  return dot(visible, wo) > 0.0f ? visible : ng;
}

}  // namespace pf
