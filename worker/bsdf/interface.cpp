#include "worker/bsdf/interface.h"

#include <cmath>

#include "worker/bsdf/albedo_table.h"
#include "worker/bsdf/fresnel.h"
#include "worker/bsdf/ggx.h"

namespace pf {
namespace {

/// Portion `chosen` of all that a microfacet passes on: its probability.
float probability(const Rgb& chosen, const Interface::Split& s) {
  const float sum = average(s.reflected) + average(s.transmitted);
  return sum > 0.0f ? average(chosen) / sum : 0.0f;
}

}  // namespace

/// Exact Fresnel, with F0 and F90 replaced as KHR_materials_specular says: its course between them is kept.
/// With specular factor and colour 1 this is the plain Fresnel reflectance. Total internal reflection stays
/// total, since no transmitted direction could take the rest. Transmitted light has what the strongest
/// channel leaves, as the extension says, so that a coloured F0 does not tint it with the complementary
/// colour.
Interface::Split Interface::transmissive_split(float cosine) const {
  Rgb r;
  if (std::isinf(eta)) {
    r = dielectric_f0 + (Rgb(dielectric_f90) - dielectric_f0) * schlick_weight(cosine);
  } else {
    const float exact = fresnel_dielectric(cosine, eta);
    const float s = (exact - exact_f0) / (1.0f - exact_f0);
    r = exact >= 1.0f ? Rgb(1.0f) : dielectric_f0 + (Rgb(dielectric_f90) - dielectric_f0) * s;
    for (int i = 0; i < 3; ++i) r[i] = std::clamp(r[i], 0.0f, 1.0f);
  }
  float passed = 1.0f - max_component(r);
  if (through == Through::kThin) {
    for (int i = 0; i < 3; ++i) r[i] = thin_sheet_reflectance(r[i]);
    passed = 1.0f - max_component(r);
  } else if (std::isinf(eta)) {
    passed = 0.0f;  // no refracted direction at an infinite index: that light is absorbed
  }
  return {r, tint * passed};
}

Interface::Split Interface::split(float cosine) const {
  Split s{f0 + (Rgb(f90) - f0) * schlick_weight(cosine), Rgb(0.0f)};
  if (transmission > 0.0f) {
    const Split t = transmissive_split(cosine);
    s.reflected += t.reflected * transmission;
    s.transmitted = t.transmitted * transmission;
  }
  return s;
}

BsdfValue Interface::reflect(const Vec3f& wo, const Vec3f& wi) const {
  const Ggx ggx{alpha};
  const Vec3f sum = wo + wi;
  const float len2 = length2(sum);
  if (!(len2 > 0.0f)) return {};
  const Vec3f h = sum * (1.0f / std::sqrt(len2));
  const Split s = split(dot(wo, h));
  // [Walter 2007, eq. 20]; density of reflected directions is that of h over 4 (wo.h), eq. 14.
  return {s.reflected * (ggx.distribution(h) * ggx.visibility(wo.z, wi.z)),
          0.25f * ggx.visible_density(wo.z, h) * probability(s.reflected, s)};
}

/// KHR_materials_transmission: the reflection lobe, mirrored at the sheet.
BsdfValue Interface::transmit_thin(const Vec3f& wo, const Vec3f& wi) const {
  const Ggx ggx{alpha};
  const Vec3f mirrored(wi.x, wi.y, -wi.z);
  const Vec3f sum = wo + mirrored;
  const float len2 = length2(sum);
  if (!(len2 > 0.0f)) return {};
  const Vec3f h = sum * (1.0f / std::sqrt(len2));
  const Split s = split(dot(wo, h));
  return {s.transmitted * (ggx.distribution(h) * ggx.visibility(wo.z, mirrored.z)),
          0.25f * ggx.visible_density(wo.z, h) * probability(s.transmitted, s)};
}

/// [Walter 2007, eq. 21 and 17], with eta_i = 1 on wo's side and eta_t = eta.
BsdfValue Interface::transmit_refracting(const Vec3f& wo, const Vec3f& wi) const {
  Vec3f h = wo + wi * eta;
  const float len2 = length2(h);
  if (!(len2 > 0.0f) || std::isinf(len2)) return {};
  h *= (h.z < 0.0f ? -1.0f : 1.0f) / std::sqrt(len2);
  const float cos_o = dot(wo, h);
  const float cos_i = dot(wi, h);
  if (cos_o <= 0.0f || cos_i >= 0.0f) return {};  // a microfacet seen from behind
  const Ggx ggx{alpha};
  const Split s = split(cos_o);
  const float denominator = cos_o + eta * cos_i;
  const float jacobian = -cos_i * eta * eta / std::max(denominator * denominator, 1e-20f);
  return {s.transmitted * (4.0f * ggx.visibility(wo.z, -wi.z) * ggx.distribution(h) * cos_o * jacobian),
          ggx.visible_density(wo.z, h) * cos_o * jacobian * probability(s.transmitted, s)};
}

BsdfValue Interface::transmit(const Vec3f& wo, const Vec3f& wi) const {
  if (through == Through::kThin) return transmit_thin(wo, wi);
  if (through == Through::kRefract) return transmit_refracting(wo, wi);
  return {};
}

std::optional<Interface::Sample> Interface::sample(const Vec3f& wo, float u_choice, const Vec2f& u) const {
  const Vec3f h = is_delta() ? Vec3f(0.0f, 0.0f, 1.0f) : Ggx{alpha}.sample(wo, u);
  const float c = std::min(dot(wo, h), 1.0f);
  if (c <= 0.0f) return std::nullopt;
  return sample_about(h, wo, c, split(c), u_choice);
}

std::optional<Interface::Sample> Interface::sample_about(const Vec3f& h, const Vec3f& wo, float c, const Split& s,
                                                         float u_choice) const {
  const float r = average(s.reflected), t = average(s.transmitted);
  if (!(r + t > 0.0f)) return std::nullopt;
  const Vec3f mirrored = h * (2.0f * c) - wo;
  if (u_choice * (r + t) < r) return Sample{mirrored, s.reflected * ((r + t) / r), false};
  if (!(t > 0.0f)) return std::nullopt;
  const Rgb weight = s.transmitted * ((r + t) / t);
  if (through == Through::kThin) return Sample{Vec3f(mirrored.x, mirrored.y, -mirrored.z), weight, true};
  const float cos_t = refracted_cosine(c, eta);
  return Sample{normalize(h * (c / eta - cos_t) - wo * (1.0f / eta)), weight, true};
}

Rgb Interface::albedo(float cosine) const {
  if (is_delta()) {
    const Split s = split(cosine);
    return s.reflected + s.transmitted;
  }
  const GgxAlbedo& e = GgxAlbedo::get();
  const float e0 = e.f0.at(cosine, roughness);
  const float e90 = e.f90.at(cosine, roughness);
  Rgb sum = f0 * e0 + Rgb(f90 * e90);
  if (transmission > 0.0f) {
    const Split s = transmissive_split(cosine);
    // Refracted light leaves steeply and is masked less than reflected light: measured on furnaces of rough
    // glass.
    const float lost = through == Through::kThin ? 1.0f : eta > 1.0f ? 0.25f : 0.8f;
    sum += (s.reflected * (e0 + e90) + s.transmitted * (1.0f - lost * (1.0f - e0 - e90))) * transmission;
  }
  return sum;
}

}  // namespace pf
