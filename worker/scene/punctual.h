#pragma once

#include "common/math/vec.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// Angular part of a spot light [KHR_lights_punctual, "Inner and Outer Cone Angles"]: with c the cosine of
/// the angle to the axis, f(c) = saturate((c - cos_outer) * scale)^2, scale = 1 / max(0.001, cos_inner -
/// cos_outer).
class SpotCone {
 public:
  explicit SpotCone(const PunctualLight& light);
  [[nodiscard]] float falloff(float cosine) const;
  /// Integral of f over the sphere of directions [sr].
  [[nodiscard]] float solid_angle() const { return solid_angle_; }
  /// Cosine distributed as f; pdf_w = f / solid_angle(). Closed form, monotone in u.
  [[nodiscard]] float sample_cosine(float u) const;

 private:
  double cos_outer_ = 0, width_ = 1;  ///< f rises from 0 to 1 over `width` of cosine
  double ramp_ = 1;                   ///< part of `width` that lies below cosine 1
  float solid_angle_ = 0;
  double flat_share_ = 0;  ///< share of the flux where f = 1
};

/// Radiant intensity [W/sr] of a point or spot light in unit direction `d` away from it.
[[nodiscard]] Rgb intensity_towards(const PunctualLight& light, const Vec3f& d);

/// Flux [W] of a point or spot light.
[[nodiscard]] Rgb punctual_flux(const PunctualLight& light);

/// Unit direction distributed as the light's intensity (point or spot).
[[nodiscard]] Vec3f sample_intensity(const PunctualLight& light, const Vec2f& u);

}  // namespace pf
