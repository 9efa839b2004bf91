#pragma once

#include <cmath>

#include "common/math/frame.h"
#include "common/math/sampling.h"
#include "worker/bsdf/visible_normal.h"

namespace pf {

/// A cosine-weighted direction on wo's side of a Lambert reflector; see BsdfSample.
struct LambertSample {
  Vec3f wi;
  float pdf_w;
  Rgb weight;
  bool valid;  ///< false: below the geometric surface
};

/// `ng` and `shading.n` on the side of `wo`. With `flux`, Veach's correction for the shading normal is in the weight.
[[nodiscard]] inline LambertSample sample_lambert(const Frame& shading, const Vec3f& ng, const Vec3f& wo, const Rgb& albedo,
                                                  const Vec2f& u, bool flux) {
  const Vec3f local = sample_cosine_hemisphere(u);
  LambertSample s{shading.to_world(local), local.z * kInvPi, albedo, true};
  const float wi_ng = dot(s.wi, ng);
  s.valid = local.z > 0.0f && wi_ng > 0.0f;
  if (flux && shading.n != ng) s.weight *= dot(wo, shading.n) * wi_ng / (dot(wo, ng) * local.z);
  return s;
}

/// A surface that is one Lambert reflector whatever is around it (is_plain_lambert() in bsdf.h), as photons meet it: what Bsdf
/// gives for it, to the bit, without what only other surfaces need. Normals are unit and on the mesh's front side.
class LambertSurface {
 public:
  LambertSurface(const Vec3f& ng, const Vec3f& ns, const Vec3f& wo) : wo_(wo) {
    const float side = dot(wo, ng);
    const bool front = side >= 0.0f;
    seen_ = std::abs(side) > kGrazing;  // false for NaN
    ng_ = front ? ng : -ng;
    ns_ = visible_normal(ns, front, ng_, wo);
  }
  /// Cosines of wo below which a surface is taken as seen edge-on: black.
  static constexpr float kGrazing = 1e-9f;

  [[nodiscard]] bool seen() const { return seen_; }
  [[nodiscard]] const Vec3f& ng() const { return ng_; }
  [[nodiscard]] const Vec3f& ns() const { return ns_; }
  [[nodiscard]] LambertSample sample_flux(const Rgb& albedo, const Vec2f& u) const {
    return sample_lambert(Frame::from_normal(ns_), ng_, wo_, albedo, u, true);
  }

 private:
  Vec3f wo_, ng_, ns_;
  bool seen_;
};

}  // namespace pf
