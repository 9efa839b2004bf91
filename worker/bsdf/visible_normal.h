#pragma once

#include <algorithm>

#include "common/math/frame.h"
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

/// Turns `n` so that the mirror image of wo leaves the surface: the reflected ray is lifted, and the normal
/// is then halfway between it and wo [Keller et al. 2017, "The Iray Light Transport Simulation and Rendering
/// System"].
[[nodiscard]] inline Vec3f turn_to_mirror_outwards(const Vec3f& n, const Vec3f& ng, const Vec3f& wo, float limit) {
  const Vec3f mirrored = n * (2.0f * dot(wo, n)) - wo;
  const float height = dot(mirrored, ng);
  if (height >= limit) return n;
  const Vec3f sum = wo + normalize(mirrored + ng * (limit - height));
  return length2(sum) > 1e-6f ? normalize(sum) : ng;  // shorter: only rounding is left of it
}

/// The frame that light is mirrored in at a point whose visible normal is that of `shading`.
[[nodiscard]] inline Frame mirror_frame(const Frame& shading, const Vec3f& ng, const Vec3f& wo) {
  if (shading.n == ng) return shading;
  const Vec3f turned = turn_to_mirror_outwards(shading.n, ng, wo, view_limit(ng, wo));
  if (turned == shading.n) return shading;
  return Frame::from_normal(dot(turned, wo) > 0.0f ? turned : ng);
}

}  // namespace pf
