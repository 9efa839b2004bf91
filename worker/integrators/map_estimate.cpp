#include "worker/integrators/map_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "worker/photon/covered_area.h"
#include "worker/photon/projection_map.h"

namespace pf {
namespace {

/// Cells of the lights' views that photons of this purpose go through; null where the job wants none or all
/// would be On.
std::unique_ptr<const ProjectionMap> projection_of(const Scene& scene, const JobSpec& spec,
                                                   TracedPhotons::Purpose purpose) {
  if (spec.photon_map.projection_map == Switch::kOff) return nullptr;
  SurfaceBalls balls(scene.bounds());
  scene.for_each_triangle([&](const std::array<Vec3f, 3>& corners, int material) {
    balls.add(corners, scene.plain_lambert(material) == nullptr);
  });
  const bool caustics = purpose == TracedPhotons::Purpose::kCaustics;
  auto map = std::make_unique<const ProjectionMap>(
      scene.lights(), scene.bounds(), balls.balls(),
      caustics ? ProjectionMap::Target::kSpecular : ProjectionMap::Target::kAnySurface);
  const bool useful = spec.photon_map.projection_map == Switch::kOn || map->sparse();
  return useful ? std::move(map) : nullptr;
}

}  // namespace

TracedPhotons::TracedPhotons(const Scene& scene, const JobSpec& spec, Purpose purpose, int max_depth) {
  const bool caustics = purpose == Purpose::kCaustics;
  if (caustics && spec.photon_map.caustic_map == Switch::kOff) return;
  const auto projection = projection_of(scene, spec, purpose);
  PhotonOptions options = photon_options(spec);
  if (caustics) options.paths = static_cast<std::uint32_t>(spec.photon_map.caustic_photons);
  options.max_depth = max_depth;
  options.direct = !caustics;
  options.caustics_only = caustics;
  options.projection = projection.get();
  const PhotonTracer tracer(scene, options);
  batch = tracer.trace(caustics ? 1 : 0);
  paths = options.paths;
  flux_unit = tracer.flux_unit();
}

TileFigures TracedPhotons::figures() const {
  const std::size_t stored = batch.direct.size() + batch.flows[kCaustic].size() + batch.flows[kIndirect].size();
  return {batch.rays, paths, stored, batch.faults};
}

MapEstimate::MapEstimate(const Scene& scene, std::span<const Photons* const> flows, double flux_unit,
                         const Options& options)
    : map_(flows), options_(options), filter_(options.filter), flux_unit_(flux_unit) {
  if (map_.empty()) return;  // reaches nowhere, so that nobody looks for edges on its behalf
  max_distance_ = options.max_distance > 0.0 ? static_cast<float>(options.max_distance) : choose_max_distance(scene);
}

float MapEstimate::choose_max_distance(const Scene& scene) const {
  const float largest = kLargestShare * 0.5f * length(scene.bounds().size());
  constexpr std::size_t kSamples = 255;
  const std::size_t samples = std::min(kSamples, map_.size());
  std::vector<float> radii2;
  NearestPhotons found;
  for (std::size_t i = 0; i < samples; ++i) {
    const StoredPhoton& photon = map_.photon(static_cast<std::uint32_t>(1 + i * map_.size() / samples));
    map_.nearest({photon.point(), surface_normal(photon), kInfinity, options_.nearest + 1, false}, found);
    radii2.push_back(found.radius2);
  }
  const auto middle = radii2.begin() + static_cast<std::ptrdiff_t>(radii2.size() / 2);
  std::nth_element(radii2.begin(), middle, radii2.end());
  const float reach = kReach * std::sqrt(*middle);
  return reach > 0.0f ? std::min(reach, largest) : largest;
}

const NearestPhotons& MapEstimate::find(const Vec3f& position, const Vec3f& normal, bool both_sides) const {
  // Allocated once a thread; maps that take turns do not start from each other's radii.
  constexpr std::size_t kMaps = 4;
  thread_local std::array<NearestPhotons, kMaps> answers;
  NearestPhotons& found = answers[reinterpret_cast<std::uintptr_t>(this) / sizeof(MapEstimate) % kMaps];
  map_.nearest({position, normal, max_distance_ * max_distance_, options_.nearest, both_sides}, found);
  return found;
}

Rgb MapEstimate::radiance(const Scene& scene, const Vertex& vertex, Portion portion, float covered, const Vec2f& u,
                          TileFigures& figures) const {
  if (map_.empty()) return {0.0f, 0.0f, 0.0f};
  DiscQuery disc = disc_at(vertex, max_distance_);
  const NearestPhotons& found = find(disc.position, disc.normal, disc.both_sides);
  if (found.count == 0) return {0.0f, 0.0f, 0.0f};
  const Bsdf& bsdf = vertex.bsdf;
  Rgb radiance;
  if (portion == Portion::kGather && bsdf.gather_is_lambert()) {
    radiance = bsdf.lambert_f() * filter_.irradiance(map_, found);
  } else {
    radiance = filter_.scattered(map_, found, [&](const Vec3f& towards_light) {
      return bsdf.eval(vertex.wo, towards_light, Transport::kRadiance, portion);
    });
  }
  disc.radius2 = found.radius2;
  if (disc.radius2 > covered * covered)
    radiance /= measure_coverage(scene, vertex.point, disc, u, figures.rays).fraction;
  radiance *= static_cast<float>(flux_unit_);
  if (is_finite(radiance)) return radiance;
  ++figures.faults.not_finite;
  return {0.0f, 0.0f, 0.0f};
}

MapEstimate::Irradiance MapEstimate::irradiance(const Vec3f& position, const Vec3f& normal) const {
  const NearestPhotons& found = find(position, normal, false);
  return {filter_.irradiance(map_, found) * static_cast<float>(flux_unit_), std::sqrt(found.radius2)};
}

MapEstimate::Options global_options(const JobSpec& spec) {
  return {static_cast<std::uint32_t>(spec.photon_map.nearest), spec.photon_map.max_distance, spec.photon_map.filter};
}

MapEstimate::Options caustic_options(const JobSpec& spec) {
  return {static_cast<std::uint32_t>(spec.photon_map.caustic_nearest), spec.photon_map.max_distance,
          spec.photon_map.filter};
}

}  // namespace pf
