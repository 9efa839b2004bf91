#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "common/math/frame.h"
#include "common/math/vec.h"
#include "worker/bsdf/coat.h"
#include "worker/bsdf/interface.h"

namespace pf {

/// What flows along the path that is being built. Radiance (from the eye) scales with (eta_i/eta_t)^2 at a
/// refraction, flux (photons) does not [Veach 1997, 5.2]; with shading normals flux needs the correction of
/// [Veach 1997, 5.3].
enum class Transport { kRadiance, kFlux };

/// Which part of a BSDF. Every lobe l has a gather share g_l in [0,1]: 1 for diffuse and sheen, 0 for delta
/// lobes, and for a GGX lobe a smooth, monotone function of its alpha (no roughness cliff). kGather scales
/// each lobe by g_l, kFollow by 1-g_l, kAll by 1; so kGather + kFollow = kAll.
enum class Portion { kAll, kGather, kFollow };

/// A material's parameters at one surface point, textures and vertex colours applied. Both normals are unit
/// and lie on the mesh's front side; the BSDF turns them itself towards wo.
struct SurfaceParams {
  Vec3f ng{0, 0, 1};  ///< geometric normal of the front face
  Vec3f ns{0, 0, 1};  ///< shading normal (interpolated, normal-mapped)
  Vec3f clearcoat_ns{0, 0, 1};
  Rgb base_color{1, 1, 1};
  float metallic = 0, roughness = 1;
  float ior = 1.5f;  ///< of the material; 0: infinite (Fresnel 1)
  float specular = 1;
  Rgb specular_color{1, 1, 1};
  float transmission = 0;
  bool thin_walled = true;   ///< transmission passes straight through (Fresnel on both faces), no refraction
  float eta_outside = 1.0f;  ///< ior of the medium in front of the front face (from the path's medium stack)
  float clearcoat = 0, clearcoat_roughness = 0;
  Rgb sheen_color{0, 0, 0};
  float sheen_roughness = 0;
  bool scatters = true;  ///< false for unlit: the BSDF is zero
};

/// Albedo of a surface that is one Lambert reflector whatever medium is around it, and empty for any other. Photons
/// meet such a surface as LambertLanes.
[[nodiscard]] std::optional<Rgb> plain_lambert_albedo(const SurfaceParams& p);

struct BsdfSample {
  Vec3f wi;                  ///< unit, away from the surface
  Rgb weight;                ///< f |cos(ns, wi)| / pdf_w; for Transport::kFlux with Veach's shading-normal correction
  float pdf_w = 0;           ///< per steradian, lobe choice included; 0 for a delta lobe
  bool delta = false;        ///< a Dirac lobe was sampled
  bool transmitted = false;  ///< wi lies on the other side (of ng) than wo
  bool refracted = false;    ///< transmitted into or out of a medium (not thin-walled): its stack changes
  float specularity = 0;     ///< 1 - g_l of the sampled lobe: 1 mirror-like ... 0 diffuse
};

/// Scattering at one surface point: Lambert, GGX conductor and dielectric (rough, smooth, thin or
/// refracting), clearcoat and sheen, layered as the glTF 2.0 material model and its KHR extensions say. All
/// directions are world-space, unit, and point away from the surface. Built on the stack per hit; cheap for
/// pure Lambert.
///
/// From the top, with m = metallic, t = transmission:
///   clearcoat, over sheen, over a mix of metal (m), dielectric over Lambert ((1-m)(1-t)) and transmissive
///   dielectric ((1-m) t).
///
/// - Metal and opaque dielectric: GGX with Schlick's Fresnel; F0 and F90 from base colour, ior and
///   KHR_materials_specular.
/// - The opaque dielectric leaves rho (1-E(wo)) (1-E(wi)) / (1 - mean E) to Lambert, E being its directional
///   albedo [Kelemen and Szirmay-Kalos 2001]. Unlike glTF's 1 - F(wo.h) this is reciprocal and keeps all
///   energy.
/// - Transmissive dielectric: exact Fresnel. Refracting: base colour tints once per crossing, so twice for a
///   body that is entered and left. Thin-walled: one crossing is both faces, reflects 2R/(1+R), tints once.
/// - Equal indices on both sides: no reflection, light goes straight on.
/// - Sheen and coat scale what lies below by min(1 - E(wo), 1 - E(wi)): reciprocal, and never above 1 in sum.
///   glTF's coat has 1 - F(wo.n) alone.
/// - Every layer works from both sides.
///
/// Sides: wo is above; wi is above when wi.ng > 0. Where wi.ns says otherwise the BSDF is zero, so that no
/// light leaks through. A shading normal tilted by d then costs (1 - cos d) / 2 of Lambert (0.8 % at 10
/// degrees), and of the flux, not the radiance, of a mirror (1 - cos 2d) / 2. A shading normal that wo sees
/// from below is turned just far enough towards wo. Where it would mirror wo into the surface, the lobes that
/// mirror use a normal of their own that does not; what is matte keeps the one given.
class Bsdf {
 public:
  /// `wo` fixes which side is up. Never fails: impossible input gives a BSDF that is zero.
  Bsdf(const SurfaceParams& p, const Vec3f& wo);

  // In the functions below `wo` is the one given to the constructor.

  /// f(wo, wi) in 1/sr of the non-delta lobes, without the cosine. At a refraction, with wo in the medium of
  /// index eta_i and wi in that of eta_t: kFlux gives the f that conserves flux (f / eta_t^2 is symmetric);
  /// kRadiance gives (eta_i/eta_t)^2 times that. The shading-normal correction is in neither: it belongs to
  /// the cosines, and is part of sample().weight alone. f(wo, wi, kRadiance) = f(wi, wo, kFlux) wherever
  /// neither direction turns the shading normal.
  [[nodiscard]] Rgb eval(const Vec3f& wo, const Vec3f& wi, Transport mode, Portion portion = Portion::kAll) const;
  /// Density per steradian with which sample() of the same portion returns the non-delta direction wi.
  [[nodiscard]] float pdf(const Vec3f& wo, const Vec3f& wi, Transport mode, Portion portion = Portion::kAll) const;
  /// Draws a direction. `u_lobe` chooses the lobe by intervals in a fixed order and then, in the rest of its
  /// interval, reflection or transmission. Empty when absorbed or when the sample failed (below the surface).
  [[nodiscard]] std::optional<BsdfSample> sample(const Vec3f& wo, float u_lobe, const Vec2f& u, Transport mode,
                                                 Portion portion = Portion::kAll) const;
  /// Approximate directional-hemispherical albedo of a portion, seen from wo (delta lobes included), in
  /// [0,1]; for choosing, never for shading.
  [[nodiscard]] Rgb albedo(Portion portion) const;
  /// For a smooth boundary that both reflects and transmits and has no other lobe to follow: the part of u_lobe's
  /// interval, from 0 on, in which sample() reflects. A path may then be split in two with these weights. Otherwise 0.
  [[nodiscard]] float split_probability() const;
  /// Share g of a GGX lobe of width `alpha` that is gathered from photons instead of followed: smoothstep in
  /// perceptual roughness sqrt(alpha), 0 up to alpha = 0.01 and 1 from alpha = 0.5. A density estimate of a
  /// lobe of solid angle about pi alpha^2 uses only that part of the photons found, so it is noise for narrow
  /// lobes; following one ray finds few of what a wide lobe sees. In roughness the change is spread evenly
  /// over what looks different.
  [[nodiscard]] static float gather_share(float alpha);

  /// True when the gather portion is one Lambert reflector: then eval(..., kGather) is lambert_f() on wo's
  /// side.
  [[nodiscard]] bool gather_is_lambert() const { return gather_is_lambert_; }
  [[nodiscard]] const Rgb& lambert_f() const { return lambert_f_; }
  [[nodiscard]] bool has_delta() const { return has_delta_; }
  [[nodiscard]] bool is_delta_only() const { return is_delta_only_; }
  [[nodiscard]] bool is_black() const { return is_black_; }
  /// Normals turned to wo's side.
  [[nodiscard]] const Vec3f& ng() const { return ng_; }
  [[nodiscard]] const Vec3f& ns() const { return shading_.n; }

 private:
  enum Lobe : std::uint8_t { kDiffuse, kSheen, kCoat, kInterface, kStraight, kLobes };
  using PerLobe = std::array<float, kLobes>;

  /// What a surface that is more than one Lambert reflector needs. Left unwritten otherwise: Lambert stays
  /// cheap.
  struct Layers {
    Vec3f wo;                       ///< local to the shading frame
    Frame mirror;                   ///< of the interface: the shading frame, or one that mirrors wo outwards
    Vec3f mirror_wo;                ///< local to `mirror`
    Rgb diffuse;                    ///< f of Lambert, (1 - E(wo)) / (1 - mean E) included
    float diffuse_f0, diffuse_f90;  ///< of the dielectric above Lambert; both 0: none
    Interface interface;
    Rgb straight;  ///< portion that passes unbent into a medium of equal index
    Rgb sheen;
    float sheen_roughness;
    float sheen_max, sheen_albedo;  ///< strongest channel; albedo of white sheen seen from wo, may exceed 1
    Coat coat;
    float coat_albedo;  ///< of a full coat, seen from wo
    float gather_interface, gather_coat;
    bool thin;
    std::array<Rgb, kLobes> albedo;  ///< approximate, seen from wo
    PerLobe choice;                  ///< weight of choosing each lobe, not normalised
  };

  void build_layers(const SurfaceParams& p, const Vec3f& wo);
  void build_base(const SurfaceParams& p);
  void build_coat(const SurfaceParams& p, const Vec3f& wo);
  void estimate_albedo();
  void set_flags();

  [[nodiscard]] float share(Lobe lobe, Portion portion) const;
  /// Probability of choosing each lobe in a portion; all zero when there is none.
  [[nodiscard]] PerLobe probabilities(Portion portion) const;
  [[nodiscard]] BsdfValue evaluate(const Vec3f& wi, Transport mode, Portion portion) const;
  [[nodiscard]] BsdfValue evaluate_interface(const Vec3f& wi, float wi_ns, Transport mode) const;
  [[nodiscard]] BsdfValue evaluate_coat(const Vec3f& wi, float wi_ns, Transport mode) const;
  /// What a lobe of its own normal, with these cosines to it, needs because the caller's cosine is to ns.
  [[nodiscard]] float cosine_ratio(float lobe_wo, float lobe_wi, float wi_ns, Transport mode) const;
  /// Factors on the base and on sheen for light that goes from wi through the layers above them and on to wo.
  struct Scales {
    float base, sheen;
  };
  [[nodiscard]] Scales scales(float wi_ns, const Vec3f& wi) const;
  /// Directional albedo of the dielectric above the Lambert part.
  [[nodiscard]] float diffuse_boundary_albedo(float cosine) const;
  [[nodiscard]] std::optional<BsdfSample> sample_lambert(const Vec2f& u, Transport mode) const;
  [[nodiscard]] std::optional<BsdfSample> sample_interface(float u_choice, const Vec2f& u, Transport mode,
                                                           Portion portion, float probability) const;
  [[nodiscard]] std::optional<BsdfSample> finish(const Vec3f& wi, bool transmitted, Lobe lobe, Transport mode,
                                                 Portion portion) const;
  [[nodiscard]] std::optional<BsdfSample> finish_delta(const Vec3f& wi, const Rgb& weight, bool transmitted,
                                                       const Vec3f& normal, Transport mode) const;

  Vec3f ng_;
  Frame shading_;
  Vec3f wo_;
  Rgb lambert_f_{0, 0, 0};
  Rgb lambert_albedo_{0, 0, 0};
  bool gather_is_lambert_ = false;
  bool has_delta_ = false;
  bool is_delta_only_ = false;
  bool is_black_ = false;
  bool front_ = true;
  bool layered_ = false;  ///< `layers_` is written
  Layers layers_;
};

}  // namespace pf
