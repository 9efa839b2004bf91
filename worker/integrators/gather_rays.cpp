#include "worker/integrators/gather_rays.h"

#include <algorithm>
#include <array>
#include <vector>

#include "common/base/parallel.h"
#include "common/math/sampling.h"
#include "worker/photon/covered_area.h"

namespace pf {
namespace {

/// Irradiance is estimated at one of so many photons: [Christensen 1999] found a quarter of them as good as
/// all.
constexpr std::size_t kEvery = 4;
/// Photons side by side whose discs share the probes of their edges.
constexpr std::size_t kChunk = 256;

/// Nodes of the tree from left to right, every kEvery-th of them: neighbours in space follow each other.
void list_in_order(std::size_t node, std::size_t count, std::size_t& number, std::vector<std::uint32_t>& chosen) {
  if (node > count) return;
  list_in_order(2 * node, count, number, chosen);
  if (number++ % kEvery == 0) chosen.push_back(static_cast<std::uint32_t>(node));
  list_in_order(2 * node + 1, count, number, chosen);
}

/// Bounces of the light that reaches what a gather ray meets: the gather point's own is one of the job's.
int depth_behind_gather(int max_depth) { return max_depth == 0 ? 0 : max_depth - 1; }

}  // namespace

MapGather::MapGather(const Scene& scene, const JobSpec& spec) : scene_(scene), max_depth_(spec.integrator.max_depth) {
  if (max_depth_ == 1) return;  // all light that arrives is direct
  const TracedPhotons global(scene, spec, TracedPhotons::Purpose::kGlobal, depth_behind_gather(max_depth_));
  const Photons* all[] = {&global.batch.direct, &global.batch.flows[kCaustic], &global.batch.flows[kIndirect]};
  map_ = MapEstimate(scene, all, global.flux_unit, global_options(spec));
  figures_ = global.figures();
  if (spec.final_gather.importance > 0.0) indirect_ = PhotonMap(std::span(all).last(1));
  if (spec.final_gather.precompute) precompute(spec);
}

void MapGather::precompute(const JobSpec& spec) {
  precomputed_ = true;
  std::vector<std::uint32_t> chosen;
  std::size_t number = 0;
  list_in_order(1, map_.photons().size(), number, chosen);
  const float extent = std::max(max_magnitude(scene_.bounds().min), max_magnitude(scene_.bounds().max));
  Photons records(chosen.size());
  const std::size_t chunks = (chosen.size() + kChunk - 1) / kChunk;
  std::vector<TileFigures> figures(chunks);
  parallel_for(chunks, [&](std::size_t chunk) {
    const std::size_t first = chunk * kChunk, last = std::min(chosen.size(), first + kChunk);
    std::vector<GatherDisc> discs;
    std::vector<Rgb> irradiances;
    for (std::size_t i = first; i < last; ++i) {
      const StoredPhoton& photon = map_.photons().photon(chosen[i]);
      const Vec3f normal = surface_normal(photon);
      const MapEstimate::Irradiance found = map_.irradiance(photon.point(), normal);
      PathRng rng(spec.integrator.seed, Stream::kProbe, 0, chosen[i]);
      const SurfacePoint point{.position = photon.point(), .ng = normal, .ns = normal, .extent = extent};
      discs.push_back({point, {photon.point(), normal, found.radius * found.radius, false}, rng.next2()});
      irradiances.push_back(found.irradiance);
    }
    find_covered_radii(scene_, discs, figures[chunk].rays);
    for (std::size_t i = first; i < last; ++i) {
      const GatherDisc& disc = discs[i - first];
      Rgb irradiance = irradiances[i - first];
      if (disc.query.radius2 > disc.covered_radius * disc.covered_radius) {
        irradiance /= measure_coverage(scene_, disc.point, disc.query, disc.u, figures[chunk].rays).fraction;
      }
      if (!is_finite(irradiance)) {
        ++figures[chunk].faults.not_finite;
        irradiance = {0.0f, 0.0f, 0.0f};
      }
      records[i] = make_photon(disc.query.position, irradiance, disc.query.normal, disc.query.normal);
    }
  });
  for (const TileFigures& f : figures) figures_ += f;
  const Photons* all[] = {&records};
  irradiance_ = PhotonMap(all);
}

Rgb MapGather::precomputed(const Vec3f& position, const Vec3f& normal) const {
  const float reach = 2.0f * map_.max_distance();
  const std::uint32_t index = irradiance_.nearest_one({position, normal, reach * reach, 1, false});
  return index == 0 ? Rgb{0.0f, 0.0f, 0.0f} : unpack_rgbe(irradiance_.photon(index).flux);
}

Rgb MapGather::leaving(const Vertex& vertex, PathRng& rng, TileFigures& figures) const {
  if (precomputed_ && vertex.bsdf.gather_is_lambert()) {
    return vertex.bsdf.lambert_f() * precomputed(vertex.point.position, vertex.bsdf.ng());
  }
  return map_.radiance(scene_, vertex, Portion::kGather, 0.0f, rng.next2(), figures);
}

GatherRadiance::Arrival MapGather::arriving(const Ray& ray, const MediumStack& media, PathRng& rng,
                                            TileFigures& figures) const {
  constexpr int kFirstRoulette = 4;
  constexpr float kMaxSurvival = 0.95f;  // ends rays caught between perfect mirrors
  Arrival arrival;
  Ray at = ray;
  MediumStack inside = media;
  Vec3f from = ray.origin;
  Rgb beta{1.0f, 1.0f, 1.0f};
  for (int bounce = 1; max_depth_ == 0 || bounce < max_depth_; ++bounce) {
    ++figures.rays;
    const auto hit = scene_.intersect(at);
    if (!hit) return arrival;
    if (bounce == 1) arrival.distance = hit->t;
    if (!inside.empty()) beta *= inside.transmittance(scene_, length(hit->position - from));
    const Vertex vertex(scene_, *hit, -at.direction, inside);
    const Bsdf& bsdf = vertex.bsdf;
    const float gathered = average(bsdf.albedo(Portion::kGather)), followed = average(bsdf.albedo(Portion::kFollow));
    if (bsdf.is_black() || !(gathered + followed > 0.0f)) return arrival;
    const float p_gather = gathered / (gathered + followed);
    const float u = p_gather < 1.0f ? rng.next1() : 0.0f;
    if (u < p_gather) {
      const Rgb radiance = leaving(vertex, rng, figures) * beta / p_gather;
      if (is_finite(radiance)) {
        arrival.radiance = radiance;
      } else {
        ++figures.faults.not_finite;
      }
      return arrival;
    }
    const float p_follow = 1.0f - p_gather;
    const float u_lobe = std::min((u - p_gather) / p_follow, kOneMinusEpsilon);
    const auto next = bsdf.sample(vertex.wo, u_lobe, rng.next2(), Transport::kRadiance, Portion::kFollow);
    if (!next) return arrival;
    beta *= next->weight / p_follow;
    if (next->refracted) inside.cross(hit->material, vertex.entering());
    from = hit->position;
    at = {offset_past(*hit, next->wi), next->wi};
    if (bounce >= kFirstRoulette) {
      const float survival = std::min(kMaxSurvival, max_component(beta));
      if (!(survival > 0.0f) || rng.next1() >= survival) return arrival;
      beta /= survival;
    }
  }
  return arrival;
}

}  // namespace pf
