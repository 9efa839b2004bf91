#include "worker/bsdf/bsdf.h"

#include <cmath>

#include "common/math/sampling.h"
#include "worker/bsdf/albedo_table.h"
#include "worker/bsdf/charlie.h"
#include "worker/bsdf/fresnel.h"
#include "worker/bsdf/ggx.h"
#include "worker/bsdf/lambert.h"

namespace pf {
namespace {

constexpr float kUniformHemisphere = 0.5f * kInvPi;

}  // namespace

float Bsdf::gather_share(float alpha) {
  constexpr float kFollow = 0.1f;          // sqrt(0.01)
  constexpr float kGather = 0.707106781f;  // sqrt(0.5)
  const float roughness = std::sqrt(std::max(alpha, 0.0f));
  const float t = std::clamp((roughness - kFollow) / (kGather - kFollow), 0.0f, 1.0f);
  return t * t * (3.0f - 2.0f * t);
}

float Bsdf::share(Lobe lobe, Portion portion) const {
  if (portion == Portion::kAll) return 1.0f;
  float gathered = 0.0f;
  if (lobe == kDiffuse || lobe == kSheen) gathered = 1.0f;
  if (lobe == kCoat) gathered = layers_.gather_coat;
  if (lobe == kInterface) gathered = layers_.gather_interface;
  return portion == Portion::kGather ? gathered : 1.0f - gathered;
}

Bsdf::PerLobe Bsdf::probabilities(Portion portion) const {
  PerLobe p;
  float sum = 0.0f;
  for (int lobe = 0; lobe < kLobes; ++lobe) {
    p[lobe] = layers_.choice[lobe] * share(static_cast<Lobe>(lobe), portion);
    sum += p[lobe];
  }
  for (float& x : p) x = sum > 0.0f ? x / sum : 0.0f;
  return p;
}

Rgb Bsdf::albedo(Portion portion) const {
  if (is_black_) return Rgb(0.0f);
  if (!layered_) return portion == Portion::kFollow ? Rgb(0.0f) : lambert_albedo_;
  Rgb sum(0.0f);
  for (int lobe = 0; lobe < kLobes; ++lobe) {
    sum += layers_.albedo[lobe] * share(static_cast<Lobe>(lobe), portion);
  }
  return {std::min(sum.x, 1.0f), std::min(sum.y, 1.0f), std::min(sum.z, 1.0f)};
}

Rgb Bsdf::eval(const Vec3f&, const Vec3f& wi, Transport mode, Portion portion) const {
  if (is_black_) return Rgb(0.0f);
  if (!layered_ || (portion == Portion::kGather && gather_is_lambert_)) {
    const bool lit = portion != Portion::kFollow && dot(wi, ng_) > 0.0f && dot(wi, shading_.n) > 0.0f;
    return lit ? lambert_f_ : Rgb(0.0f);
  }
  return evaluate(wi, mode, portion).f;
}

float Bsdf::pdf(const Vec3f&, const Vec3f& wi, Transport mode, Portion portion) const {
  if (is_black_) return 0.0f;
  if (!layered_) {
    const float cosine = dot(wi, shading_.n);
    return portion != Portion::kFollow && cosine > 0.0f && dot(wi, ng_) > 0.0f ? cosine * kInvPi : 0.0f;
  }
  return evaluate(wi, mode, portion).pdf;
}

Bsdf::Scales Bsdf::scales(float wi_ns, const Vec3f& wi) const {
  const Layers& l = layers_;
  Scales scale{1.0f, 1.0f};
  if (l.coat.weight > 0.0f) {
    const float seen = l.coat.albedo(std::min(1.0f, std::abs(dot(wi, l.coat.frame.n))));
    scale.base = scale.sheen = 1.0f - l.coat.weight * std::max(seen, l.coat_albedo);
  }
  if (l.sheen_max > 0.0f) {
    const float seen = std::max(sheen_albedo().at(std::abs(wi_ns), l.sheen_roughness), l.sheen_albedo);
    scale.base *= std::max(0.0f, 1.0f - l.sheen_max * seen);
    // The fitted masking lets a narrow lobe reflect more than everything at the horizon.
    scale.sheen /= std::max(1.0f, seen);
  }
  return scale;
}

float Bsdf::diffuse_boundary_albedo(float cosine) const {
  const Layers& l = layers_;
  if (l.diffuse_f90 == 0.0f) return 0.0f;
  const Interface& i = l.interface;
  if (i.is_delta()) {
    const float s = schlick_weight(cosine);
    return l.diffuse_f0 * (1.0f - s) + l.diffuse_f90 * s;
  }
  const GgxAlbedo& e = GgxAlbedo::get();
  return l.diffuse_f0 * e.f0.at(cosine, i.roughness) + l.diffuse_f90 * e.f90.at(cosine, i.roughness);
}

float Bsdf::cosine_ratio(float lobe_wo, float lobe_wi, float wi_ns, Transport mode) const {
  constexpr float kMost = 8.0f;  // at the horizon of ns it would be infinite
  const float ratio = mode == Transport::kRadiance ? std::abs(lobe_wi / wi_ns) : lobe_wo / layers_.wo.z;
  return std::min(ratio, kMost);
}

BsdfValue Bsdf::evaluate_interface(const Vec3f& wi, float wi_ns, Transport mode) const {
  const Layers& l = layers_;
  const Interface& i = l.interface;
  const Vec3f local = l.mirror.to_local(wi);
  const bool transmitted = local.z < 0.0f;
  if (transmitted != (wi_ns < 0.0f)) return {};
  if (transmitted ? i.through == Interface::Through::kNothing : !i.present()) return {};
  BsdfValue value = transmitted ? i.transmit(l.mirror_wo, local) : i.reflect(l.mirror_wo, local);
  const bool refracts = transmitted && i.through == Interface::Through::kRefract;
  if (refracts && mode == Transport::kRadiance) value.f *= 1.0f / (i.eta * i.eta);
  if (l.mirror.n != shading_.n) value.f *= cosine_ratio(l.mirror_wo.z, local.z, wi_ns, mode);
  return value;
}

BsdfValue Bsdf::evaluate_coat(const Vec3f& wi, float wi_ns, Transport mode) const {
  const Coat& c = layers_.coat;
  const Vec3f local = c.frame.to_local(wi);
  const Vec3f sum = c.wo + local;
  const float len2 = length2(sum);
  if (local.z <= 0.0f || !(len2 > 0.0f)) return {};
  const Ggx ggx{c.alpha};
  const Vec3f h = sum * (1.0f / std::sqrt(len2));
  const float f = c.weight * c.reflectance(dot(c.wo, h)) * ggx.distribution(h) * ggx.visibility(c.wo.z, local.z) *
                  cosine_ratio(c.wo.z, local.z, wi_ns, mode);
  return {Rgb(f), 0.25f * ggx.visible_density(c.wo.z, h)};
}

BsdfValue Bsdf::evaluate(const Vec3f& wi, Transport mode, Portion portion) const {
  const Layers& l = layers_;
  const float wi_ns = dot(wi, shading_.n);
  const float wi_ng = dot(wi, ng_);
  const bool sides_agree = (wi_ns > 0.0f && wi_ng > 0.0f) || (wi_ns < 0.0f && wi_ng < 0.0f);
  if (!sides_agree) return {};
  const PerLobe p = probabilities(portion);
  const Scales scale = scales(wi_ns, wi);
  BsdfValue sum;
  const auto add = [&sum](const BsdfValue& lobe, float weight, float probability) {
    sum.f += lobe.f * weight;
    sum.pdf += lobe.pdf * probability;
  };
  const float share_interface = l.interface.is_delta() ? 0.0f : share(kInterface, portion);
  if (share_interface > 0.0f) {
    add(evaluate_interface(wi, wi_ns, mode), share_interface * scale.base, p[kInterface]);
  }
  if (wi_ns < 0.0f) return sum;
  if (portion != Portion::kFollow && p[kDiffuse] > 0.0f) {
    const float passed = std::max(1.0f - diffuse_boundary_albedo(wi_ns), 0.0f);
    add({l.diffuse * passed, wi_ns * kInvPi}, scale.base, p[kDiffuse]);
  }
  if (portion != Portion::kFollow && l.sheen_max > 0.0f) {
    const float value = Charlie(l.sheen_roughness).eval(l.wo, shading_.to_local(wi));
    add({l.sheen * value, kUniformHemisphere}, scale.sheen, p[kSheen]);
  }
  const float share_coat = l.coat.weight > 0.0f && l.coat.alpha > 0.0f ? share(kCoat, portion) : 0.0f;
  if (share_coat > 0.0f) add(evaluate_coat(wi, wi_ns, mode), share_coat, p[kCoat]);
  return sum;
}

std::optional<BsdfSample> Bsdf::sample(const Vec3f&, float u_lobe, const Vec2f& u, Transport mode,
                                       Portion portion) const {
  if (is_black_) return std::nullopt;
  if (!layered_) return portion == Portion::kFollow ? std::nullopt : sample_lambert(u, mode);

  const Layers& l = layers_;
  const PerLobe p = probabilities(portion);
  int lobe = 0;
  float below = 0.0f;  // probability of the lobes before this one
  while (lobe + 1 < kLobes && u_lobe >= below + p[lobe]) below += p[lobe++];
  while (lobe > 0 && p[lobe] == 0.0f) below -= p[--lobe];  // rounding has led past the last possible lobe
  if (p[lobe] == 0.0f) return std::nullopt;

  switch (static_cast<Lobe>(lobe)) {
    case kDiffuse:
      return finish(shading_.to_world(sample_cosine_hemisphere(u)), false, kDiffuse, mode, portion);
    case kSheen:
      return finish(shading_.to_world(sample_cone(u, 0.0f)), false, kSheen, mode, portion);
    case kCoat: {
      const bool mirror = l.coat.alpha == 0.0f;
      const Vec3f h = mirror ? Vec3f(0.0f, 0.0f, 1.0f) : Ggx{l.coat.alpha}.sample(l.coat.wo, u);
      const Vec3f wi = normalize(l.coat.frame.to_world(h * (2.0f * dot(l.coat.wo, h)) - l.coat.wo));
      if (!mirror) return finish(wi, false, kCoat, mode, portion);
      return finish_delta(wi, l.albedo[kCoat] * (1.0f / p[kCoat]), false, l.coat.frame.n, mode);
    }
    case kInterface: {
      const float u_choice = std::clamp((u_lobe - below) / p[kInterface], 0.0f, kOneMinusEpsilon);
      return sample_interface(u_choice, u, mode, portion, p[kInterface]);
    }
    default: {
      const float scale = scales(l.wo.z, -wo_).base;
      return finish_delta(-wo_, l.straight * (scale / p[kStraight]), true, ng_, mode);
    }
  }
}

std::optional<BsdfSample> Bsdf::sample_lambert(const Vec2f& u, Transport mode) const {
  const LambertSample drawn = pf::sample_lambert(shading_, ng_, wo_, lambert_albedo_, u, mode == Transport::kFlux);
  if (!drawn.valid) return std::nullopt;
  BsdfSample s;
  s.wi = drawn.wi;
  s.pdf_w = drawn.pdf_w;
  s.weight = drawn.weight;
  return s;
}

std::optional<BsdfSample> Bsdf::sample_interface(float u_choice, const Vec2f& u, Transport mode, Portion portion,
                                                 float probability) const {
  const Interface& i = layers_.interface;
  const std::optional<Interface::Sample> drawn = i.sample(layers_.mirror_wo, u_choice, u);
  if (!drawn) return std::nullopt;
  const bool straight = drawn->transmitted && i.is_delta() && i.through == Interface::Through::kThin;
  const Vec3f wi = straight ? -wo_ : normalize(layers_.mirror.to_world(drawn->wi));
  if (!i.is_delta()) return finish(wi, drawn->transmitted, kInterface, mode, portion);
  Rgb weight = drawn->weight * (scales(drawn->wi.z, wi).base / probability);
  if (mode == Transport::kRadiance && drawn->transmitted && i.through == Interface::Through::kRefract) {
    weight *= 1.0f / (i.eta * i.eta);
  }
  return finish_delta(wi, weight, drawn->transmitted, layers_.mirror.n, mode);
}

float Bsdf::split_probability() const {
  if (!layered_ || !layers_.interface.is_delta()) return 0.0f;
  const PerLobe p = probabilities(Portion::kFollow);
  for (int lobe = 0; lobe < kLobes; ++lobe) {
    if (lobe != kInterface && p[lobe] > 0.0f) return 0.0f;
  }
  const Interface::Split split = layers_.interface.split(std::min(layers_.mirror_wo.z, 1.0f));
  const float r = average(split.reflected), t = average(split.transmitted);
  return r > 0.0f && t > 0.0f ? r / (r + t) : 0.0f;
}

std::optional<BsdfSample> Bsdf::finish(const Vec3f& wi, bool transmitted, Lobe lobe, Transport mode,
                                       Portion portion) const {
  // A microfacet may reflect to below the surface: that light is lost, and must not pass for transmitted
  // light.
  const float wi_ng = dot(wi, ng_);
  if ((wi_ng < 0.0f) != transmitted) return std::nullopt;
  const BsdfValue value = evaluate(wi, mode, portion);
  if (!(value.pdf > 0.0f) || !std::isfinite(value.pdf)) return std::nullopt;
  BsdfSample s;
  s.wi = wi;
  s.pdf_w = value.pdf;
  // [Veach 1997, section 5.3] replaces |wi.ns| by |wo.ns| |wi.ng| / |wo.ng| where flux is carried.
  const float cosine =
      mode == Transport::kRadiance ? std::abs(dot(wi, shading_.n)) : layers_.wo.z * std::abs(wi_ng) / dot(wo_, ng_);
  s.weight = value.f * (cosine / value.pdf);
  s.transmitted = transmitted;
  s.refracted = transmitted && !layers_.thin;
  s.specularity = 1.0f - share(lobe, Portion::kGather);
  return is_finite(s.weight) ? std::optional(s) : std::nullopt;
}

/// Empty where `wi` lies on the wrong side of the geometric surface: only with a tilted shading normal. For flux,
/// Veach's correction for it is in the weight [Veach 1997, 5.3].
std::optional<BsdfSample> Bsdf::finish_delta(const Vec3f& wi, const Rgb& weight, bool transmitted, const Vec3f& normal,
                                             Transport mode) const {
  const float wi_ng = dot(wi, ng_);
  if (!(transmitted ? wi_ng < 0.0f : wi_ng > 0.0f)) return std::nullopt;
  BsdfSample s;
  s.wi = wi;
  s.delta = true;
  s.weight = weight;
  s.transmitted = transmitted;
  s.refracted = transmitted && !layers_.thin;
  s.specularity = 1.0f;
  if (mode == Transport::kFlux && normal != ng_) {
    s.weight *= dot(wo_, normal) * std::abs(wi_ng) / (dot(wo_, ng_) * std::max(std::abs(dot(wi, normal)), 1e-9f));
  }
  return s;
}

}  // namespace pf
