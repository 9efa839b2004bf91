#pragma once

#include "common/math/lane_sampling.h"
#include "worker/bsdf/lambert.h"
#include "worker/bsdf/visible_normal_lanes.h"

namespace pf {

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
    const Vec3x8 wi = Frame8::from_normal(ns_).to_world(local);
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
