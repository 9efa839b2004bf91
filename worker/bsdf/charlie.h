#pragma once

#include <algorithm>
#include <cmath>

#include "common/math/vec.h"

namespace pf {

/// Sheen of KHR_materials_sheen: the "Charlie" distribution of cylindrical fibres and its fitted masking
/// [Estevez and Kulla 2017, "Production Friendly Microfacet Sheen BRDF"]. Fresnel is left out, as the
/// extension allows.
class Charlie {
 public:
  /// Below this sheenRoughness the lobe is a spike at the horizon that carries almost nothing but costs
  /// noise.
  static constexpr float kMinRoughness = 0.07f;
  /// Keeps the quotient by the cosines finite.
  static constexpr float kMinCosine = 1e-6f;

  /// `roughness` is glTF's sheenRoughness; alpha_g is its square.
  explicit Charlie(float roughness) : alpha_(std::clamp(roughness, kMinRoughness, 1.0f)) { alpha_ *= alpha_; }

  /// Density of fibre normals [1/sr]; `sin2_h` = 1 - (n.h)^2.
  [[nodiscard]] float distribution(float sin2_h) const {
    return normalisation() * std::pow(std::max(sin2_h, 0.0f), exponent());
  }
  [[nodiscard]] float normalisation() const { return (2.0f + 1.0f / alpha_) / (2.0f * kPi); }
  [[nodiscard]] float exponent() const { return 0.5f / alpha_; }

  /// Smith's Lambda, fitted [Estevez and Kulla 2017, section 3].
  [[nodiscard]] float lambda(float cosine) const {
    return cosine < 0.5f ? std::exp(fit(cosine)) : std::exp(2.0f * fit(0.5f) - fit(1.0f - cosine));
  }

  /// BRDF of white sheen [1/sr] from local directions on the upper hemisphere.
  [[nodiscard]] float eval(const Vec3f& wo, const Vec3f& wi) const {
    const Vec3f sum = wo + wi;
    const float len2 = length2(sum);
    if (!(len2 > 0.0f) || wo.z <= 0.0f || wi.z <= 0.0f) return 0.0f;
    const float cos_o = std::max(wo.z, kMinCosine), cos_i = std::max(wi.z, kMinCosine);
    const float visibility = 1.0f / ((1.0f + lambda(cos_o) + lambda(cos_i)) * 4.0f * cos_o * cos_i);
    return distribution((sum.x * sum.x + sum.y * sum.y) / len2) * visibility;
  }

 private:
  [[nodiscard]] float fit(float x) const {
    const float q = (1.0f - alpha_) * (1.0f - alpha_);
    const auto mix = [q](float at0, float at1) { return at0 + (at1 - at0) * q; };
    return mix(21.5473f, 25.3245f) / (1.0f + mix(3.82987f, 3.32435f) * std::pow(x, mix(0.19823f, 0.16801f))) +
           mix(-1.97760f, -1.27393f) * x + mix(-4.32054f, -4.85967f);
  }

  float alpha_;
};

}  // namespace pf
