#include "worker/photon/photon_tracer.h"

#include <algorithm>
#include <vector>

#include <tbb/parallel_for.h>

#include "common/math/philox.h"
#include "worker/photon/photon_tree.h"
#include "worker/scene/medium_stack.h"

namespace pf {

/// A photon on its way.
struct PhotonTracer::Walk {
  Ray ray;
  Rgb flux;                    ///< in units of flux_unit()
  MediumStack media;
  bool specular_only = true;   ///< no diffuse bounce yet
};

PhotonTracer::PhotonTracer(const Scene& scene, const PhotonOptions& options)
    : scene_(scene),
      options_(options),
      flux_unit_(static_cast<double>(average(scene.lights().total_flux())) / options.paths) {}

PhotonBatch PhotonTracer::trace(std::uint64_t sub_pass) const {
  // Paths are cut into chunks of a fixed size, each with its own batch, joined in order.
  constexpr std::uint32_t kChunk = 8192;
  PhotonBatch all;
  if (flux_unit_ <= 0.0) return all;
  const std::uint32_t chunks = (options_.paths + kChunk - 1) / kChunk;
  std::vector<PhotonBatch> parts(chunks);
  tbb::parallel_for(std::uint32_t{0}, chunks, [&](std::uint32_t chunk) {
    const std::uint32_t end = std::min(options_.paths, (chunk + 1) * kChunk);
    for (std::uint32_t path = chunk * kChunk; path < end; ++path) trace_path(sub_pass, path, parts[chunk]);
  });
  for (std::size_t flow = 0; flow < kFlows; ++flow) {
    PhotonArrays& joined = all.flows[flow];
    std::size_t count = 0;
    for (const PhotonBatch& part : parts) count += part.flows[flow].size();
    joined.for_each_field([&](auto field) {
      auto& values = joined.*field;
      values.reserve(count + PhotonTree::kWidth);
      for (PhotonBatch& part : parts) {
        auto& from = part.flows[flow].*field;
        values.insert(values.end(), from.begin(), from.end());
        from = {};
      }
    });
  }
  for (const PhotonBatch& part : parts) {
    all.rays += part.rays;
    all.faults += part.faults;
  }
  return all;
}

void PhotonTracer::store(const Walk& walk, const SurfacePoint& point, const Vec3f& wo, const Vec3f& ng, const Vec3f& ns,
                         PhotonBatch& batch) const {
  Rgb flux = walk.flux;
  const float geometric = dot(wo, ng);
  const float shading = dot(wo, ns);
  if (geometric <= 0.0f || shading <= 0.0f) return;
  if (shading != geometric) flux *= shading / geometric;
  if (!is_finite(flux)) {
    ++batch.faults.not_finite;
    return;
  }
  if (max_component(flux) > kMaxPhotonFlux) {
    ++batch.faults.overflow;
    return;
  }
  batch.flows[walk.specular_only ? kCaustic : kIndirect].push(point.position, flux, wo, ng);
}

void PhotonTracer::trace_path(std::uint64_t sub_pass, std::uint32_t path, PhotonBatch& batch) const {
  PathRng rng(options_.seed, Stream::kPhoton, sub_pass, path);
  const float u_light = rng.next1();
  const Vec2f u_position = rng.next2();
  const auto picked = scene_.lights().emit(u_light, u_position, rng.next2());
  if (!picked) return;
  Walk walk;
  walk.ray = {picked->emission.origin, picked->emission.direction};
  walk.flux = picked->emission.flux * static_cast<float>(1.0 / (flux_unit_ * options_.paths));
  if (picked->triangle >= 0) {
    const auto index = static_cast<std::uint32_t>(picked->triangle);
    walk.flux *= scene_.emission_ratio(index, picked->barycentric);
    walk.media = MediumStack(scene_.media_of_emitter(index));
  } else if (scene_.any_medium()) {
    walk.media = MediumStack(scene_.media_around(picked->emission.origin));
  }
  if (!(max_component(walk.flux) > 0.0f)) return;

  for (int bounce = 0; options_.max_depth == 0 || bounce < options_.max_depth; ++bounce) {
    ++batch.rays;
    const auto point = scene_.intersect(walk.ray);
    if (!point) return;
    if (!walk.media.empty()) walk.flux *= walk.media.transmittance(scene_, point->t);
    const Vec3f wo = -walk.ray.direction;
    const bool entering = dot(wo, point->ng) > 0.0f;
    const Bsdf bsdf(scene_.evaluate(*point, walk.media.eta_outside(scene_, point->material, entering)), wo);
    if (bsdf.is_black()) return;
    if (bounce > 0 && !bsdf.is_delta_only()) store(walk, *point, wo, bsdf.ng(), bsdf.ns(), batch);

    const float u_lobe = rng.next1();
    const auto sample = bsdf.sample(wo, u_lobe, rng.next2(), Transport::kFlux);
    if (!sample) return;
    // A rough reflection counts as specular with the probability that it is followed rather than gathered.
    if (sample->specularity <= 0.0f || (sample->specularity < 1.0f && rng.next1() >= sample->specularity)) {
      walk.specular_only = false;
    }
    // Russian roulette on the largest channel keeps photons whole [Jensen 2001, 5.2.4].
    const Rgb flux = walk.flux * sample->weight;
    const float survival = std::min(1.0f, max_component(flux) / max_component(walk.flux));
    if (!(survival > 0.0f)) return;
    if (survival < 1.0f) {
      if (rng.next1() >= survival) return;
      walk.flux = flux / survival;
    } else {
      walk.flux = flux;
    }
    if (sample->refracted) walk.media.cross(point->material, entering);
    walk.ray = {offset_past(*point, sample->wi), sample->wi};
  }
}

}  // namespace pf
