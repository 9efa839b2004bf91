#include "worker/photon/irradiance_update.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "common/base/parallel.h"
#include "common/math/offset.h"
#include "common/math/philox.h"
#include "common/math/sampling.h"
#include "worker/scene/medium_stack.h"

namespace pf {
namespace {

/// Cubes along the longest side of the scene.
constexpr float kCubes = 32.0f;
/// Paths from the lamps of the new scene, and from each lamp that is gone.
constexpr std::uint32_t kPaths = 1u << 17;
constexpr std::uint32_t kGonePaths = 1u << 14;
constexpr std::uint32_t kChunk = 2048;
/// Bounces of a photon at most: it carries a thousandth by then, even between bright walls.
constexpr int kMaxBounces = 16;
/// A gather ray that crosses the change may now bring so many times what the record's rays bring on average.
constexpr float kContrast = 4.0f;
/// Steps of the sums: this part of the scene's flux.
constexpr float kFluxStep = 0x1p-40f;

}  // namespace

struct ChangedLight::Photon {
  Ray ray;
  Rgb flux;
  MediumStack media;
  int bounce = 0;
  bool changed = false;
};

/// The photons that come from one.
class ChangedLight::Walk {
 public:
  Walk(ChangedLight& light, PathRng rng, int max_depth)
      : light_(light), scene_(light.scene_), change_(light.change_), rng_(rng), max_depth_(max_depth) {}
  void follow(const Photon& first) {
    pending_.push_back(first);
    while (!pending_.empty() && rays_ < kMostRays) {
      const Photon photon = pending_.back();
      pending_.pop_back();
      step(photon);
    }
    light_.rays_ += rays_;
    rays_ = 0;
    pending_.clear();
  }

 private:
  static constexpr std::uint64_t kMostRays = 256;

  void step(Photon photon) {
    ++rays_;
    const auto hit = scene_.intersect(photon.ray);
    float enter = kInfinity;
    const bool crosses = change_.crossed(photon.ray.origin, photon.ray.direction, hit ? hit->t : kInfinity, &enter);
    if (crosses && !photon.changed) {
      photon.changed = true;
      // In the other scene something else may stand here.
      Photon other = photon;
      other.ray = {photon.ray.origin + photon.ray.direction * enter, sample_sphere(rng_.next2())};
      ++other.bounce;
      if (!beyond(other)) pending_.push_back(other);
    }
    if (!hit) return;
    if (photon.changed && change_.holds(hit->position)) {
      // In the other scene nothing may stand here.
      Photon through = photon;
      through.ray.origin = offset_past(*hit, photon.ray.direction);
      pending_.push_back(through);
    }
    scatter(photon, *hit);
  }

  void scatter(Photon& photon, const SurfacePoint& point) {
    if (!photon.media.empty()) photon.flux *= photon.media.transmittance(scene_, point.t);
    const Vec3f wo = -photon.ray.direction;
    const bool entering = dot(wo, point.ng) > 0.0f;
    const Bsdf bsdf(scene_.evaluate(point, photon.media.eta_outside(scene_, point.material, entering)), wo);
    if (bsdf.is_black()) return;
    if (photon.changed) {
      const float reflected = luminance(photon.flux * bsdf.albedo(Portion::kGather));
      if (reflected > 0.0f && std::isfinite(reflected)) {
        light_.steps_[light_.cell(point.position)] += static_cast<std::uint64_t>(reflected / light_.unit_);
      }
    }
    const float u_lobe = rng_.next1();
    const auto next = bsdf.sample(wo, u_lobe, rng_.next2(), Transport::kFlux);
    if (!next) return;
    const float survival = std::min(1.0f, max_component(photon.flux * next->weight) / max_component(photon.flux));
    if (!(survival > 0.0f) || rng_.next1() >= survival) return;
    photon.flux *= next->weight / survival;
    if (next->refracted) photon.media.cross(point.material, entering);
    photon.ray = {offset_past(point, next->wi), next->wi};
    ++photon.bounce;
    if (!beyond(photon)) pending_.push_back(photon);
  }
  [[nodiscard]] bool beyond(const Photon& photon) const {
    return photon.bounce >= (max_depth_ > 0 ? std::min(max_depth_, kMaxBounces) : kMaxBounces);
  }

  ChangedLight& light_;
  const Scene& scene_;
  const SceneChange& change_;
  PathRng rng_;
  int max_depth_;
  std::vector<Photon> pending_;
  std::uint64_t rays_ = 0;
};

ChangedLight::ChangedLight(const Scene& scene, const SceneChange& change, int max_depth, std::uint64_t seed)
    : scene_(scene),
      change_(change),
      bounds_(scene.bounds()),
      edge_(std::max(max_component(bounds_.size()), 1e-30f) / kCubes),
      steps_(static_cast<std::size_t>(kCubes * kCubes * kCubes)) {
  float flux = luminance(scene.lights().total_flux());
  for (const ScenePart& lamp : change.gone_lights) flux += luminance(lamp.flux);
  unit_ = flux * kFluxStep;
  if (!(unit_ > 0.0f)) return;
  trace_lamps(max_depth, seed);
  for (std::size_t i = 0; i < change.gone_lights.size(); ++i) trace_gone(change.gone_lights[i], i, max_depth, seed);
}

std::size_t ChangedLight::cell(const Vec3f& point) const {
  const auto along = [&](int axis) {
    return static_cast<std::size_t>(std::clamp((point[axis] - bounds_.min[axis]) / edge_, 0.0f, kCubes - 1.0f));
  };
  constexpr auto kRow = static_cast<std::size_t>(kCubes);
  return (along(2) * kRow + along(1)) * kRow + along(0);
}

float ChangedLight::radiance(const Vec3f& point) const {
  // As if a surface filled one side of the cube.
  return static_cast<float>(steps_[cell(point)]) * unit_ / (kPi * edge_ * edge_);
}

void ChangedLight::trace_lamps(int max_depth, std::uint64_t seed) {
  if (!(luminance(scene_.lights().total_flux()) > 0.0f)) return;
  parallel_for(kPaths / kChunk, [&](std::size_t chunk) {
    for (std::uint32_t path = 0; path < kChunk; ++path) {
      const auto index = static_cast<std::uint32_t>(chunk) * kChunk + path;
      PathRng rng(seed, Stream::kIrradiance, (1ull << 46), index);
      const float u_light = rng.next1();
      const Vec2f u_position = rng.next2();
      const auto picked = scene_.lights().emit(u_light, u_position, rng.next2());
      if (!picked) continue;
      Photon photon{.ray = {picked->emission.origin, picked->emission.direction},
                    .flux = picked->emission.flux / static_cast<float>(kPaths),
                    .media = {}};
      if (picked->triangle >= 0) {
        photon.flux *= scene_.emission_ratio(static_cast<std::uint32_t>(picked->triangle), picked->barycentric);
      }
      if (scene_.any_medium()) photon.media = MediumStack(scene_.media_around(photon.ray.origin));
      if (max_component(photon.flux) > 0.0f) Walk(*this, rng, max_depth).follow(photon);
    }
  });
}

void ChangedLight::trace_gone(const ScenePart& lamp, std::uint64_t index, int max_depth, std::uint64_t seed) {
  parallel_for(kGonePaths / kChunk, [&](std::size_t chunk) {
    for (std::uint32_t path = 0; path < kChunk; ++path) {
      PathRng rng(seed, Stream::kIrradiance, (1ull << 46) + 1 + index,
                  static_cast<std::uint32_t>(chunk) * kChunk + path);
      const Vec3f size = lamp.bounds.size();
      const Vec2f xy = rng.next2();
      const Vec3f origin = lamp.bounds.min + Vec3f{size.x * xy.x, size.y * xy.y, size.z * rng.next1()};
      const Vec3f direction = Frame::from_normal(lamp.axis).to_world(sample_cone(rng.next2(), lamp.cosine));
      Photon photon{
          .ray = {origin, direction}, .flux = lamp.flux / static_cast<float>(kGonePaths), .media = {}, .changed = true};
      if (scene_.any_medium()) photon.media = MediumStack(scene_.media_around(origin));
      Walk(*this, rng, max_depth).follow(photon);
    }
  });
}

float changed_part(const IrradianceRecord& record, const RecordReach& reach, std::uint64_t seed,
                   const SceneChange& change, const ChangedLight& light) {
  const HemisphereGrid grid = record.grid();
  const Frame frame = Frame::from_normal(record.normal);
  double all = 0.0, altered = 0.0;
  std::uint32_t crossing = 0;
  for (std::uint32_t cell = 0; cell < grid.cells(); ++cell) {
    PathRng rng(seed, Stream::kIrradiance, record.id, cell);
    const Vec3f direction = frame.to_world(grid.direction(cell, rng.next2()));
    const float distance = unpack_half(reach.distance[cell]);
    const double brought = double{unpack_half(reach.luminance[cell])};
    all += brought;
    if (change.crossed(record.position, direction, distance)) {
      altered += brought;
      ++crossing;
    } else if (!std::isinf(distance)) {
      altered += double{light.radiance(record.position + direction * distance)};
    }
  }
  altered += double{kContrast} * crossing * all / grid.cells();
  return altered > 0.0 ? static_cast<float>(altered / std::max(all, 1e-30)) : 0.0f;
}

}  // namespace pf
