#include "worker/scene/lights.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/math/frame.h"
#include "common/math/offset.h"
#include "common/math/sampling.h"
#include "worker/scene/punctual.h"

namespace pf {
namespace {

/// Share of the choice between near lights (the tree), each directional light and the environment that is
/// spread evenly over those that can contribute: the estimates do not know what is occluded.
constexpr float kEvenShare = 0.2f;
/// Disc for light from outside, relative to the scene's radius from its centre: just outside.
constexpr float kDiscDistance = 1.001f;

/// Half-angle of a spot's falloff beyond its inner cone: what the tree takes for the spread around a normal.
LightBounds spot_bounds(const PunctualLight& light) {
  LightBounds bounds;
  bounds.box = Box3f(light.position);
  bounds.energy = average(light.intensity);
  if (light.kind == PunctualKind::kPoint) {
    bounds.cos_o = -1.0f;
    return bounds;
  }
  bounds.axis = light.direction;
  bounds.cos_o = std::max(light.cos_inner, light.cos_outer);
  bounds.cos_e =
      std::cos(std::acos(std::clamp(light.cos_outer, -1.0f, 1.0f)) - std::acos(std::clamp(bounds.cos_o, -1.0f, 1.0f)));
  return bounds;
}

LightBounds area_bounds(const AreaLight& light) {
  LightBounds bounds;
  bounds.box = light.box();
  bounds.axis = light.ng();
  bounds.cos_o = 1.0f;
  bounds.cos_e = 0.0f;
  bounds.energy = average(light.radiance()) * light.area();
  bounds.two_sided = light.two_sided();
  return bounds;
}

bool below(const Receiver& receiver, const Vec3f& wi) { return !receiver.transmissive && dot(receiver.n, wi) <= 0.0f; }

}  // namespace

/// Weights of the choice between the tree, the directional lights and the environment at one receiver.
struct Lights::Choice {
  float tree = 0, environment = 0;
  float total = 0;
  int active = 0;

  void add(float weight) {
    total += weight;
    active += weight > 0.0f ? 1 : 0;
  }
  [[nodiscard]] float probability(float weight) const {
    if (!(weight > 0.0f)) return 0.0f;
    if (active == 1) return 1.0f;
    return (1.0f - kEvenShare) * (weight / total) + kEvenShare / static_cast<float>(active);
  }
};

Lights::Lights(std::vector<EmissiveTriangle> triangles, std::vector<PunctualLight> punctual,
               const EnvironmentMap* environment, const Box3f& bounds)
    : triangles_(std::move(triangles)),
      punctual_(std::move(punctual)),
      environment_(environment != nullptr && environment->present() ? environment : nullptr),
      area_lights_(AreaLight::group(triangles_)),
      area_light_of_triangle_(triangles_.size(), -1) {
  for (std::size_t i = 0; i < area_lights_.size(); ++i) {
    for (const std::uint32_t t : area_lights_[i].triangles()) area_light_of_triangle_[t] = static_cast<std::int32_t>(i);
  }
  if (!bounds.isEmpty()) {
    center_ = bounds.center();
    radius_ = 0.5f * length(bounds.size());
  }
  build_tree();
  build_emission();
}

void Lights::build_tree() {
  std::vector<LightBounds> leaves;
  for (const AreaLight& light : area_lights_) leaves.push_back(area_bounds(light));
  for (std::uint32_t i = 0; i < punctual_.size(); ++i) {
    if (!(average(punctual_[i].intensity) > 0.0f)) continue;
    if (punctual_[i].kind == PunctualKind::kDirectional) {
      directional_.push_back(i);
    } else {
      near_punctual_.push_back(i);
      leaves.push_back(spot_bounds(punctual_[i]));
    }
  }
  tree_ = LightTree(leaves);
}

void Lights::build_emission() {
  const float disc = kPi * radius_ * radius_;
  for (const AreaLight& light : area_lights_) picked_flux_.push_back(light.flux());
  for (const PunctualLight& light : punctual_) {
    const bool distant = light.kind == PunctualKind::kDirectional;
    picked_flux_.push_back(distant ? light.intensity * disc : punctual_flux(light));
  }
  if (environment_ != nullptr) picked_flux_.push_back(environment_->total() * disc);
  std::vector<float> weights;
  Imath::V3d total(0.0);
  for (const Rgb& flux : picked_flux_) {
    weights.push_back(average(flux));
    total += Imath::V3d(flux);
  }
  total_flux_ = Rgb(total);
  emission_ = Distribution1D(weights);
  for (std::size_t i = 0; i < picked_flux_.size(); ++i) picked_flux_[i] /= emission_.probability(i);
}

bool Lights::empty() const { return tree_.empty() && directional_.empty() && environment_ == nullptr; }

/// What the bounds of one light in the tree do not say: which side of its plane, and a spot's falloff.
float Lights::exact(const Receiver& receiver, std::uint32_t leaf) const {
  if (leaf < area_lights_.size()) return area_lights_[leaf].faces(receiver.p) ? 1.0f : 0.0f;
  const PunctualLight& light = punctual_[near_punctual_[leaf - area_lights_.size()]];
  const Vec3f d = receiver.p - light.position;
  const float distance = length(d);
  if (!(distance > 0.0f)) return 0.0f;
  return light.kind == PunctualKind::kPoint ? 1.0f : SpotCone(light).falloff(dot(d, light.direction) / distance);
}

float Lights::tree_importance(const Receiver& receiver) const {
  return tree_.importance(receiver, [&](std::uint32_t leaf) { return exact(receiver, leaf); });
}

float Lights::directional_importance(const Receiver& receiver, std::uint32_t light) const {
  const float cosine = -dot(receiver.n, punctual_[light].direction);
  return average(punctual_[light].intensity) * (receiver.transmissive ? std::abs(cosine) : std::max(0.0f, cosine));
}

/// Irradiance below a sky as bright everywhere as the mean of the map: pi L, with total = 4 pi L.
float Lights::environment_importance() const {
  return environment_ == nullptr ? 0.0f : 0.25f * average(environment_->total());
}

Lights::Choice Lights::choice(const Receiver& receiver) const {
  Choice result;
  result.tree = tree_importance(receiver);
  result.environment = environment_importance();
  result.add(result.tree);
  result.add(result.environment);
  for (const std::uint32_t light : directional_) result.add(directional_importance(receiver, light));
  return result;
}

std::optional<Lights::Picked> Lights::sample(const Vec3f& p, const Vec3f& n, bool transmissive, float u_pick,
                                             const Vec2f& u) const {
  const Receiver receiver{p, n, transmissive};
  const Choice choice = this->choice(receiver);
  int left = choice.active;
  // Takes the next candidate if u_pick falls to it, and stretches what is left of u_pick.
  const auto taken = [&](float weight) {
    const float probability = choice.probability(weight);
    if (!(probability > 0.0f)) return 0.0f;
    if (--left == 0 || u_pick < probability) {
      u_pick = std::clamp(u_pick / probability, 0.0f, kOneMinusEpsilon);
      return probability;
    }
    u_pick -= probability;
    return 0.0f;
  };
  std::optional<Picked> picked;
  float probability = taken(choice.tree);
  if (probability > 0.0f) {
    picked = sample_tree(receiver, u_pick, u);
  } else if (left > 0 && (probability = taken(choice.environment)) > 0.0f) {
    picked = sample_environment(receiver, u);
  } else {
    for (std::size_t i = 0; i < directional_.size() && left > 0 && !picked; ++i) {
      probability = taken(directional_importance(receiver, directional_[i]));
      if (probability <= 0.0f) continue;
      const PunctualLight& light = punctual_[directional_[i]];
      picked = Picked{LightSample{-light.direction, kInfinity, light.intensity, 1.0f, true}};
    }
  }
  if (!picked) return std::nullopt;
  picked->sample.pdf_w *= probability;
  if (!(picked->sample.pdf_w > 0.0f)) return std::nullopt;
  return picked;
}

std::optional<Lights::Picked> Lights::sample_tree(const Receiver& receiver, float u_pick, const Vec2f& u) const {
  const auto pick = tree_.sample(receiver, u_pick, [&](std::uint32_t leaf) { return exact(receiver, leaf); });
  if (!pick) return std::nullopt;
  const auto areas = static_cast<std::uint32_t>(area_lights_.size());
  auto picked = pick->light < areas ? sample_area(receiver, pick->light, u)
                                    : sample_punctual(receiver, near_punctual_[pick->light - areas]);
  if (picked) picked->sample.pdf_w *= pick->probability;
  return picked;
}

std::optional<Lights::Picked> Lights::sample_area(const Receiver& receiver, std::uint32_t leaf, const Vec2f& u) const {
  const AreaLight& light = area_lights_[leaf];
  const auto sample = light.sample(receiver.p, u);
  if (!sample || below(receiver, sample->wi)) return std::nullopt;
  return Picked{LightSample{sample->wi, sample->distance, light.radiance(), sample->pdf_w, false},
                static_cast<std::int32_t>(sample->point.triangle), sample->point.barycentric};
}

std::optional<Lights::Picked> Lights::sample_punctual(const Receiver& receiver, std::uint32_t index) const {
  const PunctualLight& light = punctual_[index];
  const Vec3f d = light.position - receiver.p;
  const float distance = length(d);
  if (!(distance > 0.0f)) return std::nullopt;
  const Vec3f wi = d * (1.0f / distance);
  const Rgb radiance = intensity_towards(light, -wi) / distance / distance;
  if (below(receiver, wi) || is_zero(radiance) || !is_finite(radiance)) return std::nullopt;
  return Picked{LightSample{wi, distance, radiance, 1.0f, true}};
}

std::optional<Lights::Picked> Lights::sample_environment(const Receiver& receiver, const Vec2f& u) const {
  const auto sample = environment_->sample(u);
  if (!(sample.pdf_w > 0.0f) || below(receiver, sample.direction)) return std::nullopt;
  return Picked{LightSample{sample.direction, kInfinity, sample.radiance, sample.pdf_w, false}};
}

float Lights::pdf_w(const Vec3f& p, const Vec3f& n, bool transmissive, std::uint32_t index, const Vec3f& q) const {
  const std::int32_t leaf = area_light_of_triangle_[index];
  const Receiver receiver{p, n, transmissive};
  if (leaf < 0 || below(receiver, q - p)) return 0.0f;
  const float density = area_lights_[static_cast<std::size_t>(leaf)].pdf_w(p, q);
  if (!(density > 0.0f)) return 0.0f;
  const Choice choice = this->choice(receiver);
  return density * choice.probability(choice.tree) *
         tree_.probability(receiver, static_cast<std::uint32_t>(leaf),
                           [&](std::uint32_t i) { return exact(receiver, i); });
}

float Lights::pdf_w_environment(const Vec3f& p, const Vec3f& n, bool transmissive, const Vec3f& wi) const {
  const Receiver receiver{p, n, transmissive};
  if (environment_ == nullptr || below(receiver, wi)) return 0.0f;
  const Choice choice = this->choice(receiver);
  return choice.probability(choice.environment) * environment_->pdf_w(wi);
}

std::optional<Distribution1D::Pick> Lights::pick_emitter(float u) const {
  // With one light there is nothing to choose.
  return emission_.size() == 1 && emission_.total() > 0.0 ? std::optional(Distribution1D::Pick{0, 1.0f, u})
                                                          : emission_.sample(u);
}

std::optional<Lights::EmissionPicked> Lights::emit(float u_pick, const Vec2f& u_position,
                                                   const Vec2f& u_direction) const {
  const auto pick = pick_emitter(u_pick);
  return pick ? std::optional(emit_by(*pick, u_position, u_direction)) : std::nullopt;
}

Lights::EmissionPicked Lights::emit_by(const Distribution1D::Pick& pick, const Vec2f& u_position,
                                       const Vec2f& u_direction) const {
  const Rgb& flux = picked_flux_[pick.index];
  const std::size_t areas = area_lights_.size();
  if (pick.index < areas) {
    EmissionPicked picked = emit_area(pick.index, pick.u, u_position, u_direction);
    picked.emission.flux = flux;
    return picked;
  }
  EmissionPicked picked;
  const std::size_t index = pick.index - areas;
  if (index == punctual_.size()) {
    const auto sample = environment_->sample(u_direction);
    const float disc = kPi * radius_ * radius_;
    picked = emit_distant(-sample.direction, sample.radiance * (disc / (sample.pdf_w * pick.probability)), u_position);
  } else if (punctual_[index].kind == PunctualKind::kDirectional) {
    picked = emit_distant(punctual_[index].direction, flux, u_position);
  } else {
    picked.emission = {punctual_[index].position, sample_intensity(punctual_[index], u_direction), flux, 0};
  }
  picked.emission.light = static_cast<std::uint32_t>(triangles_.size() + index);
  return picked;
}

/// Uniform by area, cosine-weighted by direction: Le cos / (1/A * cos/pi) = pi A Le, the light's flux.
Lights::EmissionPicked Lights::emit_area(std::uint32_t index, float u_side, const Vec2f& u_position,
                                         const Vec2f& u_direction) const {
  const AreaLight& light = area_lights_[index];
  const AreaLight::Point point = light.sample_uniform(u_position);
  const bool back = light.two_sided() && u_side >= 0.5f;
  const Vec3f normal = back ? -light.ng() : light.ng();
  EmissionPicked picked;
  picked.emission.direction = normalize(Frame::from_normal(normal).to_world(sample_cosine_hemisphere(u_direction)));
  picked.emission.origin = offset_ray_origin(point.position, normal, normal, light.extent());
  picked.emission.light = point.triangle;
  picked.triangle = static_cast<std::int32_t>(point.triangle);
  picked.barycentric = point.barycentric;
  return picked;
}

/// A ray along `direction` from a disc as large as the scene's sphere and just outside it.
Lights::EmissionPicked Lights::emit_distant(const Vec3f& direction, const Rgb& flux, const Vec2f& u_position) const {
  const Vec2f disc = sample_disk(u_position);
  const Frame frame = Frame::from_normal(direction);
  EmissionPicked picked;
  picked.emission.origin = center_ + (frame.t * disc.x + frame.b * disc.y - direction * kDiscDistance) * radius_;
  picked.emission.direction = direction;
  picked.emission.flux = flux;
  return picked;
}

}  // namespace pf
