#pragma once

#include "common/math/lane_sampling.h"
#include "worker/bsdf/lambert.h"

namespace pf {

/// visible_normal(n, front, ng, wo) of eight points.
[[nodiscard]] inline Vec3x8 visible_normal(const Vec3x8& n, const Int8& front, const Vec3x8& ng, const Vec3x8& wo) {
  const Vec3x8 turned = select(front, n, -n);
  const Float8 l = length2(n);
  const Int8 as_it_is = (turned == ng) | ~((l > 0.98f) & (l < 1.02f)) | ~(dot(turned, ng) > 0.0f);
  if (lanes_of(as_it_is) == kAllLanes) return ng;
  const Float8 limit = min(all(kMinNormalTurn), 0.9f * dot(wo, ng));
  const Float8 cosine = dot(wo, turned);
  const Vec3x8 visible = select(cosine >= limit, turned, normalize(turned + wo * (limit - cosine)));
  return select(as_it_is | ~(dot(visible, wo) > 0.0f), ng, visible);
}

/// Eight points of surfaces that are one Lambert reflector whatever is around them (plain_lambert_albedo() in bsdf.h),
/// as photons meet them: what Bsdf gives, to the bit, without what only other surfaces need. Normals are unit and on
/// the mesh's front side.
class LambertLanes {
 public:
  struct Sample {
    Vec3x8 wi;
    Vec3x8 weight;
    Int8 valid;
  };

  LambertLanes(const Vec3x8& ng, const Vec3x8& ns, const Vec3x8& wo) {
    const Float8 side = dot(wo, ng);
    const Int8 front = side >= 0.0f;
    seen_ = abs(side) > kGrazing;  // false for NaN
    ng_ = select(front, ng, -ng);
    ns_ = visible_normal(ns, front, ng_, wo);
    wo_ng_ = dot(wo, ng_);
    wo_ns_ = dot(wo, ns_);
    flat_ = ns_ == ng_;
  }

  [[nodiscard]] const Int8& seen() const { return seen_; }
  [[nodiscard]] const Vec3x8& ng() const { return ng_; }
  [[nodiscard]] const Float8& wo_ng() const { return wo_ng_; }  ///< dot(wo, ng())
  [[nodiscard]] const Float8& wo_ns() const { return wo_ns_; }  ///< dot(wo, ns())
  [[nodiscard]] Sample sample_flux(const Vec3x8& albedo, const Vec2x8& u) const {
    const Vec3x8 local = sample_cosine_hemisphere(u);
    const Vec3x8 wi = to_world_about(ns_, local);
    const Float8 wi_ng = dot(wi, ng_);
    const Vec3x8 corrected = albedo * (wo_ns_ * wi_ng / (wo_ng_ * local.z));
    return {wi, select(flat_, albedo, corrected), (local.z > 0.0f) & (wi_ng > 0.0f)};
  }

 private:
  Vec3x8 ng_, ns_;
  Float8 wo_ng_, wo_ns_;
  Int8 seen_, flat_;
};

}  // namespace pf
