// How the parameters of a surface become lobes. Everything that depends on wo alone is computed here, once.
#include <cmath>

#include "worker/bsdf/albedo_table.h"
#include "worker/bsdf/bsdf.h"
#include "worker/bsdf/charlie.h"
#include "worker/bsdf/fresnel.h"
#include "worker/bsdf/lambert.h"

namespace pf {
namespace {

/// Indices closer than this (relative) are taken as equal. The reflectance left out is below 3e-7 at normal
/// incidence, and closer indices would leave a refracting half vector without digits.
constexpr float kEqualIndices = 1e-3f;

/// Clamps to [0,1]; NaN becomes 0.
float saturate(float x) { return x > 0.0f ? std::min(x, 1.0f) : 0.0f; }
Rgb saturate(const Rgb& c) { return {saturate(c.x), saturate(c.y), saturate(c.z)}; }

/// Turns `n` so that the mirror image of wo leaves the surface: the reflected ray is lifted, and the normal
/// is then halfway between it and wo [Keller et al. 2017, "The Iray Light Transport Simulation and Rendering
/// System"].
Vec3f turn_to_mirror_outwards(const Vec3f& n, const Vec3f& ng, const Vec3f& wo, float limit) {
  const Vec3f mirrored = n * (2.0f * dot(wo, n)) - wo;
  const float height = dot(mirrored, ng);
  if (height >= limit) return n;
  const Vec3f sum = wo + normalize(mirrored + ng * (limit - height));
  return length2(sum) > 1e-6f ? normalize(sum) : ng;  // shorter: only rounding is left of it
}

/// The frame that light is mirrored in at a point whose visible normal is that of `shading`.
Frame mirror_frame(const Frame& shading, const Vec3f& ng, const Vec3f& wo) {
  if (shading.n == ng) return shading;
  const Vec3f turned = turn_to_mirror_outwards(shading.n, ng, wo, view_limit(ng, wo));
  if (turned == shading.n) return shading;
  return Frame::from_normal(dot(turned, wo) > 0.0f ? turned : ng);
}

/// Refractive index of the material over that outside; infinite for ior = 0 and where no float formula would
/// tell it from infinite.
float relative_index(const SurfaceParams& p) {
  constexpr float kMost = 1000.0f;
  const float outside = p.eta_outside > 0.0f && std::isfinite(p.eta_outside) ? p.eta_outside : 1.0f;
  const float index = p.ior / outside;
  return p.ior > 0.0f && index < kMost ? std::max(index, 1.0f / kMost) : kInfinity;
}

bool indices_equal(float eta) { return std::abs(eta - 1.0f) < kEqualIndices; }

/// No metal, no transmission, no coat, no sheen.
bool is_bare(const SurfaceParams& p) {
  return !(p.metallic > 0.0f) && !(p.transmission > 0.0f) && !(p.clearcoat > 0.0f) && !(max_component(p.sheen_color) > 0.0f);
}

/// Only Lambert: bare, and nothing that reflects specularly.
bool is_pure_lambert(const SurfaceParams& p) {
  return is_bare(p) && (!(p.specular > 0.0f) || indices_equal(relative_index(p)));
}

}  // namespace

std::optional<Rgb> plain_lambert_albedo(const SurfaceParams& p) {
  if (!p.scatters || p.specular > 0.0f || !is_bare(p)) return std::nullopt;
  return saturate(p.base_color);
}

Bsdf::Bsdf(const SurfaceParams& p, const Vec3f& wo) : wo_(wo) {
  const float side = dot(wo, p.ng);
  front_ = side >= 0.0f;
  ng_ = front_ ? p.ng : -p.ng;
  // The comparison also turns away NaN.
  if (!(std::abs(side) > LambertSurface::kGrazing) || !is_unit(p.ng) || !is_unit(wo)) {
    ng_ = is_unit(p.ng) ? ng_ : Vec3f(0.0f, 0.0f, 1.0f);
    shading_ = Frame::from_normal(ng_);
    is_black_ = true;
    return;
  }
  const bool lambert = is_pure_lambert(p);
  shading_ = Frame::from_normal(visible_normal(p.ns, front_, ng_, wo));
  if (!p.scatters) {
    is_black_ = true;
  } else if (lambert) {
    lambert_albedo_ = saturate(p.base_color);
    lambert_f_ = lambert_albedo_ * kInvPi;
    is_black_ = is_zero(lambert_albedo_);
    gather_is_lambert_ = !is_black_;
  } else {
    layered_ = true;
    build_layers(p, wo);
  }
}

void Bsdf::build_layers(const SurfaceParams& p, const Vec3f& wo) {
  Layers& l = layers_;
  l.wo = shading_.to_local(wo);
  l.wo.z = std::clamp(l.wo.z, 1e-9f, 1.0f);
  l.mirror = mirror_frame(shading_, ng_, wo);
  l.mirror_wo = l.mirror.to_local(wo);
  l.mirror_wo.z = std::clamp(l.mirror_wo.z, 1e-9f, 1.0f);
  l.thin = p.thin_walled;
  build_base(p);

  l.sheen = saturate(p.sheen_color);
  l.sheen_max = max_component(l.sheen);
  l.sheen_roughness = saturate(p.sheen_roughness);
  l.sheen_albedo = l.sheen_max > 0.0f ? sheen_albedo().at(l.wo.z, l.sheen_roughness) : 0.0f;

  build_coat(p, wo);

  const Interface& i = l.interface;
  l.gather_interface = i.is_delta() ? 0.0f : gather_share(i.alpha);
  l.gather_coat = l.coat.alpha == 0.0f ? 0.0f : gather_share(l.coat.alpha);
  estimate_albedo();
  set_flags();
}

void Bsdf::build_base(const SurfaceParams& p) {
  Layers& l = layers_;
  Interface& i = l.interface;
  const Rgb base = saturate(p.base_color);
  const float metal = saturate(p.metallic);
  const float transmission = (1.0f - metal) * saturate(p.transmission);
  const float opaque = (1.0f - metal) * (1.0f - saturate(p.transmission));
  const float index = relative_index(p);
  const bool equal = indices_equal(index);
  const float specular = equal ? 0.0f : saturate(p.specular);

  i.roughness = saturate(p.roughness);
  i.alpha = alpha_from_roughness(i.roughness);
  i.exact_f0 = dielectric_f0(index);
  i.dielectric_f90 = specular;
  i.dielectric_f0 = saturate(p.specular_color * i.exact_f0) * specular;
  i.f0 = base * metal + i.dielectric_f0 * opaque;
  i.f90 = metal + specular * opaque;
  i.tint = base;
  i.transmission = equal ? 0.0f : transmission;
  i.through = i.transmission == 0.0f ? Interface::Through::kNothing
              : p.thin_walled        ? Interface::Through::kThin
                                     : Interface::Through::kRefract;
  i.eta = p.thin_walled || front_ || std::isinf(index) ? index : 1.0f / index;
  l.straight = equal ? base * transmission : Rgb(0.0f);

  l.diffuse = base * (opaque * kInvPi);
  l.albedo[kDiffuse] = base * opaque;
  l.diffuse_f0 = max_component(i.dielectric_f0);
  l.diffuse_f90 = specular;
  if (specular > 0.0f && opaque > 0.0f) {
    const float f0 = l.diffuse_f0;
    // The hemispherical mean of Schlick's weight is 1/21.
    const float mean = i.is_delta() ? f0 + (specular - f0) / 21.0f
                                    : f0 * GgxAlbedo::get().f0.mean(i.roughness) +
                                          specular * GgxAlbedo::get().f90.mean(i.roughness);
    const float passed = std::max(0.0f, 1.0f - diffuse_boundary_albedo(l.wo.z));
    l.albedo[kDiffuse] *= passed;
    // A boundary that reflects everything leaves nothing below, and no quotient to take.
    l.diffuse *= mean < 0.9999f ? passed / (1.0f - mean) : 0.0f;
  }
}

void Bsdf::build_coat(const SurfaceParams& p, const Vec3f& wo) {
  Coat& c = layers_.coat;
  c.weight = saturate(p.clearcoat);
  c.roughness = saturate(p.clearcoat_roughness);
  c.alpha = alpha_from_roughness(c.roughness);
  layers_.coat_albedo = 0.0f;
  if (c.weight == 0.0f) return;
  c.frame = mirror_frame(Frame::from_normal(visible_normal(p.clearcoat_ns, front_, ng_, wo)), ng_, wo);
  c.wo = c.frame.to_local(wo);
  c.wo.z = std::clamp(c.wo.z, 1e-9f, 1.0f);
  layers_.coat_albedo = c.albedo(c.wo.z);
}

void Bsdf::estimate_albedo() {
  Layers& l = layers_;
  const float below_coat = 1.0f - l.coat.weight * l.coat_albedo;
  const float scale = below_coat * std::max(0.0f, 1.0f - l.sheen_max * l.sheen_albedo);
  const Interface& i = l.interface;
  l.albedo[kDiffuse] *= scale;
  l.albedo[kSheen] = l.sheen * (std::min(l.sheen_albedo, 1.0f) * below_coat);
  l.albedo[kCoat] = Rgb(l.coat.weight * l.coat_albedo);
  l.albedo[kInterface] = i.present() ? i.albedo(l.mirror_wo.z) * scale : Rgb(0.0f);
  l.albedo[kStraight] = l.straight * scale;
  for (int lobe = 0; lobe < kLobes; ++lobe) l.choice[lobe] = average(l.albedo[lobe]);
  // Where an approximate albedo vanishes the lobe itself need not: it must stay possible to choose.
  constexpr float kFloor = 0.01f;
  if (l.sheen_max > 0.0f) l.choice[kSheen] = std::max(l.choice[kSheen], kFloor * average(l.sheen));
  if (i.present() && !i.is_delta()) {
    const float most = average(i.f0) + i.f90 + i.transmission;
    l.choice[kInterface] = std::max(l.choice[kInterface], kFloor * most);
  }
}

void Bsdf::set_flags() {
  const Layers& l = layers_;
  const Interface& i = l.interface;
  const bool diffuse = !is_zero(l.albedo[kDiffuse]);
  const bool sheen = l.sheen_max > 0.0f;
  const bool coat = l.coat.weight > 0.0f;
  has_delta_ = (i.is_delta() && i.present()) || !is_zero(l.straight) || (coat && l.coat.alpha == 0.0f);
  const bool spread = diffuse || sheen || (i.present() && !i.is_delta()) || (coat && l.coat.alpha > 0.0f);
  is_delta_only_ = has_delta_ && !spread;
  is_black_ = !has_delta_ && !spread;
  const bool bare = !sheen && !coat && l.diffuse_f90 == 0.0f && l.diffuse_f0 == 0.0f;
  if (diffuse && bare && l.gather_interface == 0.0f) {
    gather_is_lambert_ = true;
    lambert_f_ = l.diffuse;
  }
}

}  // namespace pf
