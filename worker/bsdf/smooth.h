#pragma once

#include <algorithm>
#include <cmath>
#include <optional>

#include "common/math/frame.h"
#include "worker/bsdf/bsdf.h"
#include "worker/bsdf/lambert.h"
#include "worker/bsdf/visible_normal.h"

namespace pf {

/// A direction that a mirror or a sharp refraction gives, with its weight before the correction for shading
/// normals.
struct DeltaDirection {
  Vec3f wi;
  Rgb weight;
  bool transmitted, thin;
};
/// The point that it leaves: `ng` and the mirror's `normal` on the side of `wo`.
struct DeltaPoint {
  Vec3f wo, ng, normal;
};
/// Empty where `wi` lies on the wrong side of the geometric surface: only with a tilted shading normal. With
/// `flux`, Veach's correction for it is in the weight [Veach 1997, 5.3].
[[nodiscard]] inline std::optional<BsdfSample> delta_sample(const DeltaDirection& d, const DeltaPoint& at, bool flux) {
  const float wi_ng = dot(d.wi, at.ng);
  if (!(d.transmitted ? wi_ng < 0.0f : wi_ng > 0.0f)) return std::nullopt;
  BsdfSample s;
  s.wi = d.wi;
  s.delta = true;
  s.weight = d.weight;
  s.transmitted = d.transmitted;
  s.refracted = d.transmitted && !d.thin;
  s.specularity = 1.0f;
  if (flux && at.normal != at.ng) {
    s.weight *=
        dot(at.wo, at.normal) * std::abs(wi_ng) / (dot(at.wo, at.ng) * std::max(std::abs(dot(d.wi, at.normal)), 1e-9f));
  }
  return s;
}

/// A material that only mirrors and refracts sharply: polished metal, clear glass, a clean sheet. Nothing of
/// it is matte, rough, coated or textured.
class SmoothMaterial {
 public:
  /// Empty for any other material. `p` holds for every point of it; normals and eta_outside are not read.
  [[nodiscard]] static std::optional<SmoothMaterial> of(const SurfaceParams& p);

  /// The boundary as met from the front or from the back; `room` is used where it has to be made. Null where
  /// it lets light go straight on into a medium of equal index: that is left to Bsdf.
  [[nodiscard]] const Interface* boundary(float eta_outside, bool front, std::optional<Interface>& room) const {
    const std::optional<Interface>& in_air = front ? front_ : back_;
    if (eta_outside != 1.0f) room = make(eta_outside, front);
    const std::optional<Interface>& met = eta_outside == 1.0f ? in_air : room;
    return met ? &*met : nullptr;
  }
  [[nodiscard]] bool thin() const { return params_.thin_walled; }

 private:
  explicit SmoothMaterial(const SurfaceParams& p);
  [[nodiscard]] std::optional<Interface> make(float eta_outside, bool front) const;

  SurfaceParams params_;
  std::optional<Interface> front_, back_;  ///< in air, where nearly all of them are
};

/// A point of a SmoothMaterial as photons meet it: what Bsdf gives for it, to the bit, without what only
/// other surfaces need. Normals are unit and on the mesh's front side.
class SmoothSurface {
 public:
  /// `boundary` must live as long as this.
  SmoothSurface(const Interface& boundary, bool thin, const Vec3f& ng, const Vec3f& ns, const Vec3f& wo)
      : boundary_(boundary), wo_(wo), thin_(thin) {
    const float side = dot(wo, ng);
    const bool front = side >= 0.0f;
    seen_ = std::abs(side) > kGrazing;  // false for NaN
    ng_ = front ? ng : -ng;
    mirror_ = mirror_frame(Frame::from_normal(visible_normal(ns, front, ng_, wo)), ng_, wo);
  }

  /// As Bsdf::sample() with Transport::kFlux. Empty also where the surface is black.
  [[nodiscard]] std::optional<BsdfSample> sample_flux(float u_lobe) const;

 private:
  const Interface& boundary_;
  Vec3f wo_, ng_;
  Frame mirror_;
  bool thin_, seen_;
};

}  // namespace pf
