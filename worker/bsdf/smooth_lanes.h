#pragma once

#include <array>

#include "common/math/lane_sampling.h"
#include "worker/bsdf/interface_lanes.h"
#include "worker/bsdf/lambert.h"
#include "worker/bsdf/visible_normal_lanes.h"

namespace pf {

/// Eight points of SmoothMaterials as photons meet them: what Bsdf gives for each, to the bit, without what only other
/// surfaces need. Normals are unit and on the mesh's front side.
class SmoothLanes {
 public:
  struct Sample {
    Vec3x8 wi;
    Vec3x8 weight;
    Int8 valid;      ///< false also where the surface is black
    Int8 refracted;  ///< into another medium
  };

  SmoothLanes(const InterfaceLanes& boundary, const Vec3x8& ng, const Vec3x8& ns, const Vec3x8& wo)
      : boundary_(boundary), wo_(wo) {
    const Float8 side = dot(wo, ng);
    const Int8 front = side >= 0.0f;
    seen_ = abs(side) > kGrazing;  // false for NaN
    ng_ = select(front, ng, -ng);
    mirror_ = Frame8::from_normal(mirror_normal(visible_normal(ns, front, ng_, wo), ng_, wo));
  }

  /// As Bsdf::sample() with Transport::kFlux.
  [[nodiscard]] Sample sample_flux(const Float8& u_lobe) const {
    Vec3x8 wo = mirror_.to_local(wo_);
    wo.z = min(max(wo.z, all(1e-9f)), all(1.0f));
    const InterfaceLanes::Sample drawn = boundary_.sample_mirror(wo, u_lobe);
    const Int8 straight = drawn.transmitted & boundary_.thin();
    const Vec3x8 wi = select(straight, -wo_, normalize(mirror_.to_world(drawn.wi)));
    const Float8 wi_ng = dot(wi, ng_);
    const Int8 right_side = drawn.transmitted ? wi_ng < 0.0f : wi_ng > 0.0f;
    const Float8 correction =
        dot(wo_, mirror_.n) * abs(wi_ng) / (dot(wo_, ng_) * max(abs(dot(wi, mirror_.n)), all(1e-9f)));
    return {wi, select(mirror_.n == ng_, drawn.weight, drawn.weight * correction), seen_ & drawn.valid & right_side,
            drawn.transmitted & ~boundary_.thin()};
  }

 private:
  const InterfaceLanes& boundary_;
  Vec3x8 wo_, ng_;
  Frame8 mirror_;
  Int8 seen_;
};

}  // namespace pf
