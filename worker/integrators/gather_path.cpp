#include "worker/integrators/gather_path.h"

#include <algorithm>

#include "common/math/sampling.h"

namespace pf {
namespace {

/// Part of the light reflected by all lobes, channel by channel, that the gather portion reflects: of the
/// light sample that direct_light() takes with the same numbers.
Rgb gather_part(const Scene& scene, const Vertex& vertex, float u_pick, const Vec2f& u) {
  if (is_zero(vertex.bsdf.albedo(Portion::kFollow))) return {1.0f, 1.0f, 1.0f};
  const auto picked = scene.lights().sample(vertex.point.position, vertex.bsdf.ns(), vertex.transmissive, u_pick, u);
  if (!picked) return {0.0f, 0.0f, 0.0f};
  const Vec3f& wi = picked->sample.wi;
  const Rgb all = vertex.bsdf.eval(vertex.wo, wi, Transport::kRadiance);
  const Rgb part = vertex.bsdf.eval(vertex.wo, wi, Transport::kRadiance, Portion::kGather);
  const auto ratio = [](float a, float b) { return b > 0.0f ? a / b : 0.0f; };
  return {ratio(part.x, all.x), ratio(part.y, all.y), ratio(part.z, all.z)};
}

}  // namespace

/// A path from the gather point on.
struct PathGather::Walk {
  Ray ray;
  MediumStack media;
  BsdfTechnique technique;
  Rgb beta{1, 1, 1};
  Rgb sum{0, 0, 0};
  bool scattered = false;  ///< by a gather portion
};

bool PathGather::scatter(Walk& walk, const Vertex& vertex, PathRng& rng, TileFigures& figures) const {
  const Bsdf& bsdf = vertex.bsdf;
  Portion portion = Portion::kAll;
  float p_portion = 1.0f;
  const float u_light = rng.next1();
  const Vec2f u_point = rng.next2();
  if (walk.scattered) {
    if (!bsdf.is_delta_only()) {
      walk.sum +=
          walk.beta * direct_light(scene_, vertex, walk.media, u_light, u_point, Portion::kAll, 1.0f, figures.rays);
    }
  } else {
    const float gathered = average(bsdf.albedo(Portion::kGather));
    const float followed = average(bsdf.albedo(Portion::kFollow));
    if (!(gathered + followed > 0.0f)) return false;
    const float p_gather = gathered / (gathered + followed);
    if (gathered > 0.0f) {
      walk.sum += walk.beta * gather_part(scene_, vertex, u_light, u_point) *
                  direct_light(scene_, vertex, walk.media, u_light, u_point, Portion::kGather, p_gather, figures.rays);
    }
    const bool gathers = rng.next1() < p_gather;
    portion = gathers ? Portion::kGather : Portion::kFollow;
    p_portion = gathers ? p_gather : 1.0f - p_gather;
    walk.scattered = gathers;
  }
  const float u_lobe = rng.next1();
  const auto next = bsdf.sample(vertex.wo, u_lobe, rng.next2(), Transport::kRadiance, portion);
  if (!next) return false;
  walk.beta *= next->weight / p_portion;
  walk.technique = {next->delta, next->pdf_w * p_portion, vertex.point.position, bsdf.ns(), vertex.transmissive};
  if (next->refracted) walk.media.cross(vertex.point.material, vertex.entering());
  walk.ray = {offset_past(vertex.point, next->wi), next->wi};
  return true;
}

GatherRadiance::Arrival PathGather::arriving(const Ray& ray, const MediumStack& media, PathRng& rng,
                                             TileFigures& figures) const {
  Arrival arrival;
  Walk walk{.ray = ray, .media = media, .technique = {.position = ray.origin}};
  for (int bounce = 1;; ++bounce) {
    ++figures.rays;
    const auto hit = scene_.intersect(walk.ray);
    if (!hit) {
      if (walk.scattered && scene_.environment().present()) {
        walk.sum += walk.beta * scene_.environment().radiance(walk.ray.direction) *
                    environment_weight(scene_, walk.ray.direction, walk.technique);
      }
      break;
    }
    if (bounce == 1) arrival.distance = hit->t;
    if (!walk.media.empty()) {
      walk.beta *= walk.media.transmittance(scene_, length(hit->position - walk.technique.position));
    }
    const Vec3f wo = -walk.ray.direction;
    if (walk.scattered && scene_.emits(*hit)) {
      walk.sum += walk.beta * scene_.emitted(*hit, wo) * emitter_weight(scene_, *hit, walk.technique);
    }
    const Vertex vertex(scene_, *hit, wo, walk.media);
    if (vertex.bsdf.is_black() || (max_depth_ > 0 && bounce >= max_depth_)) break;
    if (!scatter(walk, vertex, rng, figures)) break;

    constexpr int kFirstRoulette = 3;
    constexpr float kMaxSurvival = 0.95f;  // ends paths caught between perfect mirrors
    if (bounce >= kFirstRoulette) {
      const float survival = std::min(kMaxSurvival, max_component(walk.beta));
      if (!(survival > 0.0f) || rng.next1() >= survival) break;
      walk.beta /= survival;
    }
  }
  if (is_finite(walk.sum)) {
    arrival.radiance = walk.sum;
  } else {
    ++figures.faults.not_finite;
  }
  return arrival;
}

}  // namespace pf
