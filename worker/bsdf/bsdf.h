#pragma once

#include <array>
#include <optional>

#include "common/math/frame.h"
#include "common/math/vec.h"

namespace pf {

/// What flows along the path that is being built. Radiance (from the eye) scales with (eta_i/eta_t)^2 at a refraction,
/// flux (photons) does not [Veach 1997, 5.2]; with shading normals flux needs the correction of [Veach 1997, 5.3].
enum class Transport { kRadiance, kFlux };

/// Which part of a BSDF. Every lobe l has a gather share g_l in [0,1]: 1 for diffuse and sheen, 0 for delta lobes, and
/// for a GGX lobe a smooth, monotone function of its alpha (no roughness cliff). kGather scales each lobe by g_l, kFollow
/// by 1-g_l, kAll by 1; so kGather + kFollow = kAll.
enum class Portion { kAll, kGather, kFollow };

/// A material's parameters at one surface point, textures and vertex colours applied. Both normals are unit and lie on
/// the mesh's front side; the BSDF turns them itself towards wo.
struct SurfaceParams {
  Vec3f ng{0, 0, 1};                ///< geometric normal of the front face
  Vec3f ns{0, 0, 1};                ///< shading normal (interpolated, normal-mapped)
  Vec3f clearcoat_ns{0, 0, 1};
  Rgb base_color{1, 1, 1};
  float metallic = 0, roughness = 1;
  float ior = 1.5f;                 ///< of the material; 0: infinite (Fresnel 1)
  float specular = 1;  Rgb specular_color{1, 1, 1};
  float transmission = 0;
  bool thin_walled = true;          ///< transmission passes straight through (Fresnel on both faces), no refraction
  float eta_outside = 1.0f;         ///< ior of the medium in front of the front face (from the path's medium stack)
  float clearcoat = 0, clearcoat_roughness = 0;
  Rgb sheen_color{0, 0, 0};  float sheen_roughness = 0;
  bool scatters = true;             ///< false for unlit: the BSDF is zero
};

struct BsdfSample {
  Vec3f wi;                         ///< unit, away from the surface
  Rgb weight;                       ///< f |cos(ns, wi)| / pdf_w; for Transport::kFlux with Veach's shading-normal correction
  float pdf_w = 0;                  ///< per steradian, lobe choice included; 0 for a delta lobe
  bool delta = false;               ///< a Dirac lobe was sampled
  bool transmitted = false;         ///< wi lies on the other side (of ng) than wo
  bool refracted = false;           ///< transmitted into or out of a medium (not thin-walled): the medium stack changes
  float specularity = 0;            ///< 1 - g_l of the sampled lobe: 1 mirror-like ... 0 diffuse
};

/// Scattering at one surface point: Lambert + GGX conductor/dielectric (rough, smooth, thin or refracting) + clearcoat
/// + sheen, layered as the glTF 2.0 material model and its KHR extensions say. All directions are world-space, unit, and
/// point away from the surface. Built on the stack per hit; cheap for pure Lambert.
class Bsdf {
 public:
  /// `wo` fixes which side is up. Never fails: impossible input gives a BSDF that is zero.
  Bsdf(const SurfaceParams& p, const Vec3f& wo);

  /// f(wo, wi) in 1/sr of the non-delta lobes, without the cosine.
  [[nodiscard]] Rgb eval(const Vec3f& wo, const Vec3f& wi, Transport mode, Portion portion = Portion::kAll) const;
  /// Density per steradian with which sample() of the same portion returns the non-delta direction wi.
  [[nodiscard]] float pdf(const Vec3f& wo, const Vec3f& wi, Transport mode, Portion portion = Portion::kAll) const;
  /// Draws a direction. Empty when absorbed or when the sample failed (below the surface).
  [[nodiscard]] std::optional<BsdfSample> sample(const Vec3f& wo, float u_lobe, const Vec2f& u, Transport mode,
                                                 Portion portion = Portion::kAll) const;
  /// Approximate directional-hemispherical albedo of a portion (delta lobes included); for choosing, never for shading.
  [[nodiscard]] Rgb albedo(Portion portion) const;
  /// Share g of a GGX lobe of width `alpha` that is gathered from photons instead of followed.
  [[nodiscard]] static float gather_share(float alpha);

  /// True when the gather portion is one Lambert reflector: then eval(..., kGather) is lambert_f() on wo's side.
  [[nodiscard]] bool gather_is_lambert() const { return gather_is_lambert_; }
  [[nodiscard]] const Rgb& lambert_f() const { return lambert_f_; }
  [[nodiscard]] bool has_delta() const { return has_delta_; }
  [[nodiscard]] bool is_delta_only() const { return is_delta_only_; }
  [[nodiscard]] bool is_black() const { return is_black_; }
  /// Normals turned to wo's side.
  [[nodiscard]] const Vec3f& ng() const { return ng_; }
  [[nodiscard]] const Vec3f& ns() const { return shading_.n; }

 private:
  Vec3f ng_;
  Frame shading_;
  Rgb lambert_f_{0, 0, 0};
  bool gather_is_lambert_ = false;
  bool has_delta_ = false;
  bool is_delta_only_ = false;
  bool is_black_ = false;
  // The owner of this file completes the lobes here.
};

}  // namespace pf
