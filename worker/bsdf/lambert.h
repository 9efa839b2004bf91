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
[[nodiscard]] inline LambertSample sample_lambert(const Frame& shading, const Vec3f& ng, const Vec3f& wo,
                                                  const Rgb& albedo, const Vec2f& u, bool flux) {
  const Vec3f local = sample_cosine_hemisphere(u);
  LambertSample s{shading.to_world(local), local.z * kInvPi, albedo, true};
  const float wi_ng = dot(s.wi, ng);
  s.valid = local.z > 0.0f && wi_ng > 0.0f;
  if (flux && shading.n != ng) s.weight *= dot(wo, shading.n) * wi_ng / (dot(wo, ng) * local.z);
  return s;
}

/// Cosines of wo below which a surface is taken as seen edge-on: black.
inline constexpr float kGrazing = 1e-9f;

}  // namespace pf
