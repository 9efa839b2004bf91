// How the parameters of a surface become lobes. Everything that depends on wo alone is computed here, once.
#include <cmath>

#include "worker/bsdf/albedo_table.h"
#include "worker/bsdf/bsdf.h"
#include "worker/bsdf/charlie.h"
#include "worker/bsdf/fresnel.h"
#include "worker/bsdf/lambert.h"
#include "worker/bsdf/smooth.h"

namespace pf {
namespace {

/// Indices closer than this (relative) are taken as equal. The reflectance left out is below 3e-7 at normal
/// incidence, and closer indices would leave a refracting half vector without digits.
constexpr float kEqualIndices = 1e-3f;

/// Clamps to [0,1]; NaN becomes 0.
float saturate(float x) { return x > 0.0f ? std::min(x, 1.0f) : 0.0f; }
Rgb saturate(const Rgb& c) { return {saturate(c.x), saturate(c.y), saturate(c.z)}; }

/// Refractive index of the material over that outside; infinite for ior = 0 and where no float formula would
/// tell it from infinite.
float relative_index(const SurfaceParams& p, float eta_outside) {
  constexpr float kMost = 1000.0f;
  const float outside = eta_outside > 0.0f && std::isfinite(eta_outside) ? eta_outside : 1.0f;
  const float index = p.ior / outside;
  return p.ior > 0.0f && index < kMost ? std::max(index, 1.0f / kMost) : kInfinity;
}

bool indices_equal(float eta) { return std::abs(eta - 1.0f) < kEqualIndices; }

/// No metal, no transmission, no coat, no sheen.
bool is_bare(const SurfaceParams& p) {
  return !(p.metallic > 0.0f) && !(p.transmission > 0.0f) && !(p.clearcoat > 0.0f) &&
         !(max_component(p.sheen_color) > 0.0f);
}

/// Only Lambert: bare, and nothing that reflects specularly.
bool is_pure_lambert(const SurfaceParams& p) {
  return is_bare(p) && (!(p.specular > 0.0f) || indices_equal(relative_index(p, p.eta_outside)));
}

/// What the base material is made of: portions of its parts, and the index that they share.
struct Base {
  Rgb color;
  float metal, transmission, opaque;  ///< sum: 1
  float index;                        ///< over that outside
  bool equal;                         ///< to that outside: nothing is reflected or bent
  float specular;

  Base(const SurfaceParams& p, float eta_outside)
      : color(saturate(p.base_color)),
        metal(saturate(p.metallic)),
        transmission((1.0f - metal) * saturate(p.transmission)),
        opaque((1.0f - metal) * (1.0f - saturate(p.transmission))),
        index(relative_index(p, eta_outside)),
        equal(indices_equal(index)),
        specular(equal ? 0.0f : saturate(p.specular)) {}
};

Interface make_interface(const SurfaceParams& p, const Base& base, bool front) {
  Interface i;
  i.roughness = saturate(p.roughness);
  i.alpha = alpha_from_roughness(i.roughness);
  i.exact_f0 = dielectric_f0(base.index);
  i.dielectric_f90 = base.specular;
  i.dielectric_f0 = saturate(p.specular_color * i.exact_f0) * base.specular;
  i.f0 = base.color * base.metal + i.dielectric_f0 * base.opaque;
  i.f90 = base.metal + base.specular * base.opaque;
  i.tint = base.color;
  i.transmission = base.equal ? 0.0f : base.transmission;
  i.through = i.transmission == 0.0f ? Interface::Through::kNothing
              : p.thin_walled        ? Interface::Through::kThin
                                     : Interface::Through::kRefract;
  i.eta = p.thin_walled || front || std::isinf(base.index) ? base.index : 1.0f / base.index;
  return i;
}

}  // namespace

std::optional<Rgb> plain_lambert_albedo(const SurfaceParams& p) {
  if (!p.scatters || p.specular > 0.0f || !is_bare(p)) return std::nullopt;
  return saturate(p.base_color);
}

std::optional<SmoothMaterial> SmoothMaterial::of(const SurfaceParams& p) {
  const Base base(p, 1.0f);
  const bool layered = p.clearcoat > 0.0f || max_component(saturate(p.sheen_color)) > 0.0f;
  const bool matte = !is_zero(base.color * base.opaque) || is_bare(p);
  if (!p.scatters || layered || matte || alpha_from_roughness(saturate(p.roughness)) != 0.0f) return std::nullopt;
  return SmoothMaterial(p);
}

SmoothMaterial::SmoothMaterial(const SurfaceParams& p)
    : params_(p), front_(make(1.0f, true)), back_(make(1.0f, false)) {}

std::optional<Interface> SmoothMaterial::make(float eta_outside, bool front) const {
  const Base base(params_, eta_outside);
  if (base.equal && base.transmission > 0.0f) return std::nullopt;
  return make_interface(params_, base, front);
}

Bsdf::Bsdf(const SurfaceParams& p, const Vec3f& wo) : wo_(wo) {
  const float side = dot(wo, p.ng);
  front_ = side >= 0.0f;
  ng_ = front_ ? p.ng : -p.ng;
  // The comparison also turns away NaN.
  if (!(std::abs(side) > kGrazing) || !is_unit(p.ng) || !is_unit(wo)) {
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
  const Base base(p, p.eta_outside);
  l.interface = make_interface(p, base, front_);
  const Interface& i = l.interface;
  l.straight = base.equal ? base.color * base.transmission : Rgb(0.0f);

  l.diffuse = base.color * (base.opaque * kInvPi);
  l.albedo[kDiffuse] = base.color * base.opaque;
  l.diffuse_f0 = max_component(i.dielectric_f0);
  l.diffuse_f90 = base.specular;
  if (base.specular > 0.0f && base.opaque > 0.0f) {
    const float f0 = l.diffuse_f0;
    // The hemispherical mean of Schlick's weight is 1/21.
    const float mean = i.is_delta() ? f0 + (base.specular - f0) / 21.0f
                                    : f0 * GgxAlbedo::get().f0.mean(i.roughness) +
                                          base.specular * GgxAlbedo::get().f90.mean(i.roughness);
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
