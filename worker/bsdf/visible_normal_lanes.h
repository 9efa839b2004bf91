#pragma once

#include "common/math/lanes.h"
#include "worker/bsdf/visible_normal.h"

namespace pf {

/// What visible_normal.h computes, for eight points at once and to the same bits.

[[nodiscard]] inline Float8 view_limit(const Vec3x8& ng, const Vec3x8& wo) {
  return min(all(kMinNormalTurn), 0.9f * dot(wo, ng));
}

/// visible_normal(n, front, ng, wo) of eight points.
[[nodiscard]] inline Vec3x8 visible_normal(const Vec3x8& n, const Int8& front, const Vec3x8& ng, const Vec3x8& wo) {
  const Vec3x8 turned = select(front, n, -n);
  const Float8 l = length2(n);
  const Int8 as_it_is = (turned == ng) | ~((l > 0.98f) & (l < 1.02f)) | ~(dot(turned, ng) > 0.0f);
  if (lanes_of(as_it_is) == kAllLanes) return ng;
  const Float8 limit = view_limit(ng, wo);
  const Float8 cosine = dot(wo, turned);
  const Vec3x8 visible = select(cosine >= limit, turned, normalize(turned + wo * (limit - cosine)));
  return select(as_it_is | ~(dot(visible, wo) > 0.0f), ng, visible);
}

/// The normal of mirror_frame() where `n` is that of the shading frame.
[[nodiscard]] inline Vec3x8 mirror_normal(const Vec3x8& n, const Vec3x8& ng, const Vec3x8& wo) {
  const Vec3x8 mirrored = n * (2.0f * dot(wo, n)) - wo;
  const Float8 height = dot(mirrored, ng), limit = view_limit(ng, wo);
  const Int8 as_it_is = (n == ng) | (height >= limit);
  if (lanes_of(as_it_is) == kAllLanes) return n;
  const Vec3x8 sum = wo + normalize(mirrored + ng * (limit - height));
  const Vec3x8 turned = select(length2(sum) > 1e-6f, normalize(sum), ng);
  return select(as_it_is, n, select(dot(turned, wo) > 0.0f, turned, ng));
}

}  // namespace pf
