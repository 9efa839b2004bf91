#pragma once

#include <algorithm>
#include <vector>

#include "common/math/sampling.h"
#include "worker/integrators/eye.h"

namespace pf {

/// An eye path on its way from the camera to where it gathers.
struct EyeWalk {
  PixelSequence sequence;
  Ray ray;
  MediumStack media;
  BsdfTechnique technique;
  Rgb beta{1.0f, 1.0f, 1.0f};
  Rgb beta_emission{1.0f, 1.0f,
                    1.0f};  ///< of light met next: there the whole BSDF counts, not the followed portion alone
  float distance = 0.0f;
  int bounce = 0;
  int splits = 0;
  float split_weight = 1.0f;  ///< part of beta that stands for split branches: roulette must not count it again
};

/// Radiance that the environment sends down a path that left the scene.
[[nodiscard]] inline Rgb environment_seen(const Scene& scene, const EyeWalk& walk) {
  const EnvironmentMap& environment = scene.environment();
  if (!environment.present()) return {0.0f, 0.0f, 0.0f};
  return walk.beta_emission * environment.radiance(walk.ray.direction) *
         environment_weight(scene, walk.ray.direction, walk.technique);
}
/// Radiance that a point emits down a path that met it.
[[nodiscard]] inline Rgb emission_seen(const Scene& scene, const SurfacePoint& point, const Vec3f& wo,
                                       const EyeWalk& walk) {
  return walk.beta_emission * scene.emitted(point, wo) * emitter_weight(scene, point, walk.technique);
}

/// The eye's side of every method that gathers photons or irradiance: a path goes on where the surface reflects or
/// transmits sharply and gathers where it scatters; rough reflections do the one or the other by a share that is smooth
/// in roughness (Bsdf::gather_share), the first smooth boundaries do both.
///
/// A sink is told what a path meets; `walk` is the path as it arrives there:
///   ray()                                        one more ray is shot
///   escape(walk)                                 it leaves the scene; beta_emission and technique weigh the
///   environment emitter(point, wo, walk)                     the point emits; likewise first_hit(vertex, distance) the
///   first surface of a sample direct(vertex, u_light, u_point, p_follow, walk)   direct light of this vertex, all
///   lobes but Dirac's gather(vertex, beta, u, walk)                the path ends: what arrives here by the gather
///   portion counts beta times
class EyePaths {
 public:
  EyePaths(const Scene& scene, const Eye& eye, int max_depth) : scene_(scene), eye_(eye), max_depth_(max_depth) {}

  /// Follows the eye paths of one sample of a pixel and tells `sink` what they meet.
  template <typename Sink>
  void follow(int x, int y, std::uint64_t sample, Sink& sink) const;

 private:
  /// Follows one path to its end; a path split off at a smooth boundary is put on `pending`.
  template <typename Sink>
  void follow_one(EyeWalk walk, std::vector<EyeWalk>& pending, Sink& sink) const;
  /// Scatters at a vertex; false when the path ends there.
  template <typename Sink>
  bool scatter(EyeWalk& walk, const Vertex& vertex, std::vector<EyeWalk>& pending, Sink& sink) const;

  const Scene& scene_;
  const Eye& eye_;
  int max_depth_;
};

template <typename Sink>
void EyePaths::follow(int x, int y, std::uint64_t sample, Sink& sink) const {
  const Eye::Start start = eye_.start(x, y, sample);
  thread_local std::vector<EyeWalk> pending;  // one allocation a thread
  pending.clear();
  const BsdfTechnique lens{.position = start.ray.origin};
  follow_one(EyeWalk{.sequence = start.sequence, .ray = start.ray, .media = eye_.media(), .technique = lens}, pending,
             sink);
  while (!pending.empty()) {
    const EyeWalk next = pending.back();
    pending.pop_back();
    follow_one(next, pending, sink);
  }
}

template <typename Sink>
void EyePaths::follow_one(EyeWalk walk, std::vector<EyeWalk>& pending, Sink& sink) const {
  while (true) {
    sink.ray();
    const auto hit = scene_.intersect(walk.ray);
    if (!hit) {
      sink.escape(walk);
      return;
    }
    walk.distance += hit->t;
    if (!walk.media.empty()) {
      const Rgb transmittance = walk.media.transmittance(scene_, length(hit->position - walk.technique.position));
      walk.beta *= transmittance;
      walk.beta_emission *= transmittance;
    }
    const Vec3f wo = -walk.ray.direction;
    if (scene_.emits(*hit)) sink.emitter(*hit, wo, walk);
    const Vertex vertex(scene_, *hit, wo, walk.media);
    if (walk.bounce == 0) sink.first_hit(vertex, walk.distance);
    if (vertex.bsdf.is_black() || (max_depth_ > 0 && walk.bounce >= max_depth_)) return;
    if (!scatter(walk, vertex, pending, sink)) return;

    constexpr int kFirstRoulette = 4;
    constexpr float kMaxSurvival = 0.95f;  // ends paths caught between perfect mirrors
    if (walk.bounce++ >= kFirstRoulette) {
      const float survival = std::min(kMaxSurvival, max_component(walk.beta) / walk.split_weight);
      if (!(survival > 0.0f) || walk.sequence.next1() >= survival) return;
      walk.beta /= survival;
      walk.beta_emission /= survival;
    }
  }
}

template <typename Sink>
bool EyePaths::scatter(EyeWalk& walk, const Vertex& vertex, std::vector<EyeWalk>& pending, Sink& sink) const {
  const Bsdf& bsdf = vertex.bsdf;
  // Gather here or follow the reflection: chosen with probabilities, smooth in roughness.
  const float gathered = average(bsdf.albedo(Portion::kGather));
  const float followed = average(bsdf.albedo(Portion::kFollow));
  if (!(gathered + followed > 0.0f)) return false;
  const float p_gather = gathered / (gathered + followed);
  const float p_follow = 1.0f - p_gather;
  const float u_light = walk.sequence.next1();
  const Vec2f u_point = walk.sequence.next2();
  if (!bsdf.is_delta_only()) sink.direct(vertex, u_light, u_point, p_follow, walk);
  const float u_choice = walk.sequence.next1();
  if (u_choice < p_gather) {
    const Vec2f u = walk.sequence.next2();
    sink.gather(vertex, walk.beta / p_gather, u, walk);
    return false;
  }
  // The rest of the interval, stretched, chooses the lobe: one number keeps its stratification.
  const float u_lobe = std::min((u_choice - p_gather) / p_follow, kOneMinusEpsilon);
  const Vec2f u_direction = walk.sequence.next2();
  const auto go_on = [&](EyeWalk& branch, float u, float weight) {
    const auto next = bsdf.sample(vertex.wo, u, u_direction, Transport::kRadiance, Portion::kFollow);
    if (!next) return false;
    branch.beta_emission = branch.beta * next->weight * (weight / p_follow);
    if (!next->delta) {
      const float cosine = std::abs(dot(next->wi, bsdf.ns()));
      branch.beta_emission = branch.beta * bsdf.eval(vertex.wo, next->wi, Transport::kRadiance) *
                             (weight * cosine / (next->pdf_w * p_follow));
    }
    branch.beta *= next->weight * (weight / p_follow);
    branch.split_weight *= weight;
    branch.technique = {next->delta, next->pdf_w * p_follow, vertex.point.position, bsdf.ns(), vertex.transmissive};
    if (next->refracted) branch.media.cross(vertex.point.material, vertex.entering());
    branch.ray = {offset_past(vertex.point, next->wi), next->wi};
    return true;
  };
  // A lamp seen after three reflections inside glass still shows; weaker branches are left to chance.
  constexpr int kMaxSplits = 6;
  constexpr float kMinBranch = 1e-4f;
  float reflect = walk.splits < kMaxSplits ? bsdf.split_probability() : 0.0f;
  if (std::min(reflect, 1.0f - reflect) * max_component(walk.beta) < kMinBranch) reflect = 0.0f;
  if (reflect <= 0.0f) return go_on(walk, u_lobe, 1.0f);
  // The stronger branch goes first: it is the one whose photons steer the radius (SppmIntegrator::RadianceSink).
  ++walk.splits;
  EyeWalk other = walk;
  ++other.bounce;
  const float u_reflect = 0.5f * reflect;
  const float u_transmit = 0.5f * (1.0f + reflect);
  const bool reflect_first = reflect > 0.5f;
  if (go_on(other, reflect_first ? u_transmit : u_reflect, reflect_first ? 1.0f - reflect : reflect))
    pending.push_back(other);
  return go_on(walk, reflect_first ? u_reflect : u_transmit, reflect_first ? reflect : 1.0f - reflect);
}

}  // namespace pf
