#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "common/math/vec.h"

namespace pf {

/// Below this alpha a GGX lobe is taken as a mirror. Its half width, about 0.1 degrees, is then narrower than
/// a pixel of any usual view, next-event estimation practically never hits it, and its peak, 1/(pi alpha^2) >
/// 3e5 per steradian, comes out of float half vectors (error about 1e-7 against alpha) with less than three
/// digits.
inline constexpr float kDeltaAlpha = 1e-3f;

/// GGX alpha of a perceptual roughness in [0,1]: its square (glTF 2.0, B.2.3), 0 for a mirror.
[[nodiscard]] inline float alpha_from_roughness(float roughness) {
  const float alpha = roughness * roughness;
  return alpha < kDeltaAlpha ? 0.0f : alpha;
}

/// f (no cosine) and density per steradian of the technique that samples it.
struct BsdfValue {
  Rgb f{0, 0, 0};
  float pdf = 0;
};

/// The specular boundary of the base material: the reflection of its metallic, opaque dielectric and
/// transmissive parts, which share one distribution of microfacets, and the transmission. Directions are
/// local to the frame that it mirrors in, wo.z > 0. Plain data, written by Bsdf.
struct Interface {
  /// What becomes of light that is not reflected by the transmissive part.
  enum class Through : std::uint8_t { kNothing, kThin, kRefract };

  float alpha, roughness;  ///< alpha = 0: mirror
  Rgb f0;  ///< Schlick's F0 and F90 of the metallic and of the opaque dielectric part, in their portions
  float f90;
  float transmission;  ///< portion of the transmissive part
  Rgb dielectric_f0;   ///< F0 and F90 of the transmissive part after KHR_materials_specular
  float dielectric_f90;
  float exact_f0;  ///< F0 that follows from eta alone
  float eta;       ///< eta on the far side over eta on wo's side; infinite for ior = 0
  Rgb tint;        ///< base colour; multiplies transmitted light once per crossing
  Through through;

  [[nodiscard]] bool is_delta() const { return alpha == 0.0f; }
  [[nodiscard]] bool present() const { return f90 > 0.0f || transmission > 0.0f || max_component(f0) > 0.0f; }

  /// Portions that a microfacet reflects and transmits at angle `cosine` to wo. No channel of their sum
  /// exceeds 1.
  struct Split {
    Rgb reflected, transmitted;
  };
  [[nodiscard]] Split split(float cosine) const;

  /// Values of the rough lobe (alpha > 0); pdf given that this lobe was chosen. Transmission is that of flux:
  /// radiance has 1 / eta^2 of it.
  [[nodiscard]] BsdfValue reflect(const Vec3f& wo, const Vec3f& wi) const;
  [[nodiscard]] BsdfValue transmit(const Vec3f& wo, const Vec3f& wi) const;

  struct Sample {
    Vec3f wi;
    Rgb weight;  ///< of a mirror: portion over probability, without 1 / eta^2; else unused
    bool transmitted;
  };
  /// Draws a microfacet by `u`, then reflection or transmission by `u_choice` in proportion to split().
  [[nodiscard]] std::optional<Sample> sample(const Vec3f& wo, float u_choice, const Vec2f& u) const;
  /// The same about a given microfacet `h` that wo meets at angle `cosine` > 0, with `s` = split(cosine).
  [[nodiscard]] std::optional<Sample> sample_about(const Vec3f& h, const Vec3f& wo, float cosine, const Split& s,
                                                   float u_choice) const;

  /// Approximate directional albedo, seen from `cosine`.
  [[nodiscard]] Rgb albedo(float cosine) const;

 private:
  [[nodiscard]] Split transmissive_split(float cosine) const;
  [[nodiscard]] BsdfValue transmit_thin(const Vec3f& wo, const Vec3f& wi) const;
  [[nodiscard]] BsdfValue transmit_refracting(const Vec3f& wo, const Vec3f& wi) const;
};

}  // namespace pf
