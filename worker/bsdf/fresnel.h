#pragma once

#include <algorithm>
#include <cmath>

namespace pf {

/// (1 - cos)^5, the weight of F90 in Schlick's approximation [Schlick 1994, eq. 15]: F = F0 + (F90 - F0)
/// weight.
[[nodiscard]] inline float schlick_weight(float cos_theta) {
  const float m = std::clamp(1.0f - cos_theta, 0.0f, 1.0f);
  const float m2 = m * m;
  return m2 * m2 * m;
}

/// Reflectance at normal incidence between media whose refractive indices have the ratio `eta`; 1 for
/// infinite eta.
[[nodiscard]] inline float dielectric_f0(float eta) {
  if (std::isinf(eta)) return 1.0f;
  const float r = (eta - 1.0f) / (eta + 1.0f);
  return r * r;
}

/// Cosine of the refracted ray, 0 under total internal reflection. `eta` = eta_t / eta_i, `cos_i` >= 0.
[[nodiscard]] inline float refracted_cosine(float cos_i, float eta) {
  const float sin2_t = (1.0f - cos_i * cos_i) / (eta * eta);
  return sin2_t < 1.0f ? std::sqrt(1.0f - sin2_t) : 0.0f;
}

/// Fresnel reflectance of unpolarised light at a smooth dielectric boundary (mean of both polarisations);
/// exactly 1 under total internal reflection. `eta` = eta_t / eta_i, finite; `cos_i` in [0,1], on the side of
/// eta_i.
[[nodiscard]] inline float fresnel_dielectric(float cos_i, float eta) {
  const float cos_t = refracted_cosine(cos_i, eta);
  if (cos_t <= 0.0f) return 1.0f;
  const float r_parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
  const float r_perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
  return std::min(1.0f, 0.5f * (r_parallel * r_parallel + r_perpendicular * r_perpendicular));
}

/// Reflectance of a sheet with two parallel faces of reflectance `r` each, all orders of internal reflection
/// summed: r + (1-r)^2 r / (1-r^2) = 2r/(1+r). The sheet transmits the rest, (1-r)/(1+r).
[[nodiscard]] inline float thin_sheet_reflectance(float r) { return 2.0f * r / (1.0f + r); }

}  // namespace pf
