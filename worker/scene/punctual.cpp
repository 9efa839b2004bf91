#include "worker/scene/punctual.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/math/frame.h"
#include "common/math/sampling.h"

namespace pf {

SpotCone::SpotCone(const PunctualLight& light)
    : cos_outer_(light.cos_outer),
      width_(std::max(0.001, static_cast<double>(light.cos_inner) - static_cast<double>(light.cos_outer))),
      ramp_(std::clamp((1.0 - cos_outer_) / width_, 0.0, 1.0)) {
  // With t = (c - cos_outer) / width, the ramp's part is width * integral of t^2 from 0 to `ramp`.
  const double ramp_integral = width_ * ramp_ * ramp_ * ramp_ / 3.0;
  const double flat_integral = std::max(0.0, 1.0 - (cos_outer_ + width_));
  const double integral = ramp_integral + flat_integral;
  solid_angle_ = static_cast<float>(2.0 * std::numbers::pi * integral);
  flat_share_ = integral > 0.0 ? flat_integral / integral : 0.0;
}

float SpotCone::falloff(float cosine) const {
  const float t = std::clamp(static_cast<float>((static_cast<double>(cosine) - cos_outer_) / width_), 0.0f, 1.0f);
  return t * t;
}

float SpotCone::sample_cosine(float u) const {
  const double x = static_cast<double>(u);
  // From the axis (u = 0) outwards: the flat part, then the ramp, whose cumulative integral is t^3.
  if (x < flat_share_) return static_cast<float>(1.0 - x / flat_share_ * (1.0 - (cos_outer_ + width_)));
  const double rest = std::clamp((1.0 - x) / (1.0 - flat_share_), 0.0, 1.0);
  return static_cast<float>(std::min(1.0, cos_outer_ + width_ * ramp_ * std::cbrt(rest)));
}

Rgb intensity_towards(const PunctualLight& light, const Vec3f& d) {
  if (light.kind == PunctualKind::kPoint) return light.intensity;
  return light.intensity * SpotCone(light).falloff(dot(d, light.direction));
}

Rgb punctual_flux(const PunctualLight& light) {
  return light.intensity * (light.kind == PunctualKind::kPoint ? 4.0f * kPi : SpotCone(light).solid_angle());
}

Vec3f sample_intensity(const PunctualLight& light, const Vec2f& u) {
  if (light.kind == PunctualKind::kPoint) return sample_sphere(u);
  const float z = SpotCone(light).sample_cosine(u.x);
  const float r = std::sqrt(std::max(0.0f, 1.0f - z * z));
  const float phi = 2.0f * kPi * u.y;
  return Frame::from_normal(light.direction).to_world({r * std::cos(phi), r * std::sin(phi), z});
}

}  // namespace pf
