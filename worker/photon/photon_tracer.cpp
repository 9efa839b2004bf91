#include "worker/photon/photon_tracer.h"

#include <algorithm>
#include <bit>
#include <optional>
#include <span>
#include <vector>

#include "common/base/parallel.h"
#include "common/spec/job_spec.h"
#include "worker/bsdf/lambert_lanes.h"
#include "worker/photon/photon_lanes.h"
#include "worker/photon/photon_path.h"
#include "worker/photon/photon_tree.h"
#include "worker/photon/projection_map.h"

namespace pf {
namespace {

/// Paths are cut into chunks of a fixed size, each with its own batch, joined in order.
constexpr std::uint32_t kChunkPaths = 8192;

}  // namespace

/// One photon of eight, where the surface decides what happens to it.
struct PhotonTracer::Walk {
  const PhotonNumbers& numbers;
  std::array<float, 4> u;  ///< of this bounce: lobe, direction, roulette
  std::uint32_t path;
  Ray ray;
  Rgb flux;
  MediumStack& media;
  int bounce;
  bool specular_only;

  /// Whether the photon goes on after a bounce of this weight; its flux is then what goes on.
  [[gnu::always_inline]] bool survives(const Rgb& weight) { return roulette(flux, weight, u[3]) > 0.0f; }
  /// Sends the photon from `point` towards `wi`.
  [[gnu::always_inline]] void follow(const SurfacePoint& point, const Vec3f& wi) {
    ray.origin = offset_past(point, wi);
    ray.direction = wi;
  }
};

PhotonOptions photon_options(const JobSpec& spec) {
  return {spec.integrator.seed, static_cast<std::uint32_t>(photon_paths(spec)), spec.integrator.max_depth};
}

PhotonTracer::PhotonTracer(const Scene& scene, const PhotonOptions& options)
    : scene_(scene),
      options_(options),
      flux_unit_(static_cast<double>(average(scene.lights().total_flux())) / options.paths),
      emitted_scale_(static_cast<float>(1.0 / (flux_unit_ * options.paths))) {
  for (int material = 0; material < scene.material_count(); ++material) {
    const Rgb* albedo = scene.plain_lambert(material);
    matte_.push_back(albedo == nullptr ? std::array<float, 4>{} : std::array{albedo->x, albedo->y, albedo->z, 1.0f});
  }
}

/// Photons of some paths, a record each.
struct PhotonTracer::Part {
  std::array<Photons, kFlows + 1> flows;  ///< the last one: direct
  std::uint64_t rays = 0;
  std::uint64_t lost = 0;
  Faults faults;
};

/// What eight photons bring to the surfaces that they meet; normals on the side that they come from.
struct PhotonTracer::Arrivals {
  unsigned lanes = 0;
  Vec3x8 position, flux, wo, ng;
  Float8 wo_ng, wo_ns;
  Int8 bounce, specular_only;
  Uint8 path;
};

/// Paths that wait to be emitted, with their first numbers drawn for eight at once.
class PhotonTracer::Start {
 public:
  Start(const PhotonNumbers& numbers, std::uint32_t first, std::uint32_t end)
      : numbers_(numbers), next_(first), end_(end) {}

  /// The next path into `lane` of `photons`; false when none is left.
  bool operator()(const PhotonTracer& tracer, PhotonLanes& photons, std::size_t lane) {
    while (next_ < end_) {
      const std::size_t from = taken_++ % kLanes;
      if (from == 0) tracer.emit(numbers_, next_, emissions_);
      const std::uint32_t path = next_++;
      if (!tracer.start(emissions_, from, photons, lane)) continue;
      photons.path[lane] = path;
      return true;
    }
    return false;
  }

 private:
  const PhotonNumbers& numbers_;
  std::uint32_t next_, end_;
  std::size_t taken_ = 0;
  EmissionLanes emissions_;
};

void PhotonTracer::emit(const PhotonNumbers& numbers, std::uint32_t first, EmissionLanes& emissions) const {
  const Uint8 paths = Uint8{0, 1, 2, 3, 4, 5, 6, 7} + first;
  const auto u = numbers.draw(paths, Uint8{}), more = numbers.draw(paths, Uint8{} + 1u);
  if (guided()) return emit_guided(u, more[0], emissions);
  if (options_.projection == nullptr) return scene_.lights().emit(u[0], {u[1], u[2]}, {u[3], more[0]}, emissions);
  emissions.lanes = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const auto picked = options_.projection->emit(u[0][lane], {u[1][lane], u[2][lane]}, {u[3][lane], more[0][lane]});
    if (!picked) continue;
    emissions.set(lane, picked->emission);
    emissions.triangle[lane] = picked->triangle;
    emissions.barycentric[lane] = picked->barycentric;
  }
}

void PhotonTracer::emit_guided(std::array<Float8, 4> u, Float8 last, EmissionLanes& emissions) const {
  Float8 weight;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const EmissionGuide::Drawn drawn =
        options_.guide->draw({u[0][lane], u[1][lane], u[2][lane], u[3][lane], last[lane]});
    for (std::size_t i = 0; i < u.size(); ++i) u[i][lane] = drawn.u[i];
    last[lane] = drawn.u[4];
    weight[lane] = drawn.weight;
  }
  scene_.lights().emit(u[0], {u[1], u[2]}, {u[3], last}, emissions);
  emissions.flux = emissions.flux * weight;
}

EmissionGuide::Drawn PhotonTracer::emission(std::uint64_t sub_pass, std::uint32_t path) const {
  const PhotonNumbers numbers{options_.seed, sub_pass};
  const auto u = numbers.draw(path, 0);
  const EmissionGuide::Numbers all{u[0], u[1], u[2], u[3], numbers.draw(path, 1)[0]};
  return options_.guide == nullptr ? EmissionGuide::Drawn{all, 1.0f} : options_.guide->draw(all);
}

bool PhotonTracer::start(const EmissionLanes& emissions, std::size_t from, PhotonLanes& photons,
                         std::size_t lane) const {
  if ((emissions.lanes & (1u << from)) == 0) return false;
  const Vec3f origin = emissions.origin[from];
  const PhotonStart begins = photon_start(scene_, origin, emissions.triangle[from], emissions.barycentric[from]);
  const Rgb flux = emissions.flux[from] * emitted_scale_ * begins.texture;
  if (!(max_component(flux) > 0.0f)) return false;
  photons.ray.origin.set(lane, origin);
  photons.ray.direction.set(lane, emissions.direction[from]);
  photons.position.set(lane, begins.position);
  photons.flux.set(lane, flux);
  photons.bounce[lane] = 0;
  photons.specular_only[lane] = -1;
  photons.media[lane] = begins.media;
  return true;
}

/// Photon by photon, folded with |cos(ns)|/|cos(ng)| [Veach 1997, 5.3].
void PhotonTracer::store(const Arrivals& at, Part& part) const {
  const Float8 ratio = at.wo_ns / at.wo_ng;
  const Vec3x8 flux = select(at.wo_ns == at.wo_ng, at.flux, at.flux * ratio);
  unsigned lanes = at.lanes & lanes_of((at.wo_ng > 0.0f) & (at.wo_ns > 0.0f));
  const unsigned finite = lanes_of((abs(flux.x) < kInfinity) & (abs(flux.y) < kInfinity) & (abs(flux.z) < kInfinity));
  const unsigned bounded = lanes_of(max_component(flux) <= kMaxPhotonFlux);
  part.faults.not_finite += static_cast<std::uint64_t>(std::popcount(lanes & ~finite));
  part.faults.overflow += static_cast<std::uint64_t>(std::popcount(lanes & finite & ~bounded));
  lanes &= finite & bounded;
  if (lanes == 0) return;
  const unsigned first = lanes_of(at.bounce == 0), specular = lanes_of(at.specular_only);
  std::array<Photon, kLanes> photons = make_photons(at.position, flux, at.wo, at.ng);
  if (options_.number_photons) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) photons[lane].direction = at.path[lane];
  }
  for_each_lane(lanes, [&](std::size_t lane) {
    const unsigned bit = 1u << lane;
    const std::size_t flow = (first & bit) != 0 ? kFlows : (specular & bit) != 0 ? kCaustic : kIndirect;
    part.flows[flow].push_back(photons[lane]);
  });
}

unsigned PhotonTracer::scatter(const PhotonNumbers& numbers, const SurfaceLanes& points, PhotonLanes& photons,
                               Part& part) const {
  if (scene_.any_medium()) {
    for_each_lane(points.hits, [&](std::size_t lane) {
      const MediumStack& media = photons.media[lane];
      if (media.empty()) return;
      const float distance = length(points.position[lane] - photons.position[lane]);
      photons.flux.set(lane, photons.flux[lane] * media.transmittance(scene_, distance));
    });
  }
  photons.position = points.position;
  const std::array<Float8, 4> u = numbers.draw(photons.path, 2 + 2 * reinterpret_cast<Uint8>(photons.bounce));
  Arrivals arrivals{0,        points.position, photons.flux,   -photons.ray.direction, points.ng,
                    Float8{}, Float8{},        photons.bounce, photons.specular_only,  photons.path};
  const __m256i material = _mm256_and_si256(_mm256_load_si256(reinterpret_cast<const __m256i*>(points.material.data())),
                                            reinterpret_cast<__m256i>(mask_of(points.hits)));
  const auto of_material = [&](int offset) -> Float8 {
    return _mm256_i32gather_ps(matte_[0].data() + offset, _mm256_slli_epi32(material, 2), sizeof(float));
  };
  const Vec3x8 albedo{of_material(0), of_material(1), of_material(2)};
  const unsigned lambert = points.hits & lanes_of(of_material(3) != 0.0f);
  unsigned on = lambert == 0 ? 0 : scatter_lambert(lambert, albedo, points, u, photons, arrivals);
  for_each_lane(points.hits & ~lambert, [&](std::size_t lane) {
    Walk walk{numbers,
              {u[0][lane], u[1][lane], u[2][lane], u[3][lane]},
              photons.path[lane],
              {photons.ray.origin[lane], photons.ray.direction[lane]},
              photons.flux[lane],
              photons.media[lane],
              photons.bounce[lane],
              photons.specular_only[lane] != 0};
    const SurfacePoint point = points.point(lane);
    const SmoothMaterial* smooth = scene_.smooth_material(point.material);
    if (!(smooth != nullptr ? scatter_smooth(walk, point, *smooth, lane, arrivals)
                            : scatter_any(walk, point, lane, arrivals)))
      return;
    on |= 1u << lane;
    photons.ray.origin.set(lane, walk.ray.origin);
    photons.ray.direction.set(lane, walk.ray.direction);
    photons.flux.set(lane, walk.flux);
    photons.specular_only[lane] = walk.specular_only ? -1 : 0;
  });
  if (!options_.direct) arrivals.lanes &= ~lanes_of(arrivals.bounce == 0);
  if (arrivals.lanes != 0) store(arrivals, part);
  photons.bounce += 1;
  return options_.max_depth == 0 ? on : on & lanes_of(photons.bounce < options_.max_depth);
}

bool PhotonTracer::scatter_any(Walk& walk, const SurfacePoint& point, std::size_t lane, Arrivals& arrivals) const {
  const Vec3f wo = -walk.ray.direction;
  const bool entering = dot(wo, point.ng) > 0.0f;
  const Bsdf bsdf(scene_.evaluate(point, walk.media.eta_outside(scene_, point.material, entering)), wo);
  if (bsdf.is_black()) return false;
  if (!bsdf.is_delta_only()) {
    arrivals.lanes |= 1u << lane;
    arrivals.ng.set(lane, bsdf.ng());
    arrivals.wo_ng[lane] = dot(wo, bsdf.ng());
    arrivals.wo_ns[lane] = dot(wo, bsdf.ns());
  }
  const auto sample = bsdf.sample(wo, walk.u[0], {walk.u[1], walk.u[2]}, Transport::kFlux);
  if (!sample) return false;
  // A rough reflection counts as specular with the probability that it is followed rather than gathered.
  if (sample->specularity <= 0.0f ||
      (sample->specularity < 1.0f && walk.numbers.late(walk.path, walk.bounce) >= sample->specularity)) {
    walk.specular_only = false;
    if (options_.caustics_only) return false;
  }
  if (!walk.survives(sample->weight)) return false;
  if (sample->refracted) walk.media.cross(point.material, entering);
  walk.follow(point, sample->wi);
  return true;
}

/// The same as scatter_any(), number for number, for mirrors and clear glass: nothing is stored there.
bool PhotonTracer::scatter_smooth(Walk& walk, const SurfacePoint& point, const SmoothMaterial& material,
                                  std::size_t lane, Arrivals& arrivals) const {
  const Vec3f wo = -walk.ray.direction;
  const bool entering = dot(wo, point.ng) > 0.0f;
  std::optional<Interface> room;
  const Interface* boundary =
      material.boundary(walk.media.eta_outside(scene_, point.material, entering), entering, room);
  if (boundary == nullptr) return scatter_any(walk, point, lane, arrivals);
  const auto sample = SmoothSurface(*boundary, material.thin(), point.ng, point.ns, wo).sample_flux(walk.u[0]);
  if (!sample || !walk.survives(sample->weight)) return false;
  if (sample->refracted) walk.media.cross(point.material, entering);
  walk.follow(point, sample->wi);
  return true;
}

/// The same as scatter_any(), number for number, for the surfaces of most hits, eight at once.
unsigned PhotonTracer::scatter_lambert(unsigned lanes, const Vec3x8& albedo, const SurfaceLanes& points,
                                       const std::array<Float8, 4>& u, PhotonLanes& photons, Arrivals& arrivals) const {
  const LambertLanes surface(points.ng, points.ns, arrivals.wo);
  const Int8 black = (albedo.x == 0.0f) & (albedo.y == 0.0f) & (albedo.z == 0.0f);
  lanes &= lanes_of(surface.seen() & ~black);
  const Int8 here = mask_of(lanes);
  arrivals.lanes |= lanes;
  arrivals.ng = select(here, surface.ng(), arrivals.ng);
  arrivals.wo_ng = here ? surface.wo_ng() : arrivals.wo_ng;
  arrivals.wo_ns = here ? surface.wo_ns() : arrivals.wo_ns;
  if (options_.caustics_only) return 0;
  const LambertLanes::Sample sample = surface.sample_flux(albedo, {u[1], u[2]});
  // Walk::survives()
  const Vec3x8 left = photons.flux * sample.weight;
  const Float8 survival = min(all(1.0f), max_component(left) / max_component(photons.flux));
  const Int8 on = here & sample.valid & (u[3] < survival);
  photons.flux = select(on, select(survival < 1.0f, left / survival, left), photons.flux);
  photons.specular_only = on ? Int8{} : photons.specular_only;
  photons.ray.origin =
      select(on, offset_ray_origin(points.position, points.ng, sample.wi, points.extent), photons.ray.origin);
  photons.ray.direction = select(on, sample.wi, photons.ray.direction);
  return lanes_of(on);
}

template <typename Watch>
void PhotonTracer::trace_paths(std::uint64_t sub_pass, std::uint32_t first, std::uint32_t end, Part& part,
                               Watch&& watch) const {
  // Several packets take turns, a bounce each: what one waits for in memory the next have already asked for.
  constexpr std::size_t kPackets = 4;
  const PhotonNumbers numbers{options_.seed, sub_pass};
  std::vector<PhotonLanes> photons(kPackets);
  std::vector<SurfaceLanes> points(kPackets);
  std::array<RayLanes, kPackets> rays;
  std::array<unsigned, kPackets> alive{};
  Start start(numbers, first, end);
  const auto fill = [&](std::size_t packet, unsigned free) {
    for_each_lane(free, [&](std::size_t lane) {
      if (start(*this, photons[packet], lane)) alive[packet] |= 1u << lane;
    });
  };
  for (std::size_t packet = 0; packet < kPackets; ++packet) fill(packet, kAllLanes);
  while (std::ranges::any_of(alive, [](unsigned lanes) { return lanes != 0; })) {
    for (std::size_t packet = 0; packet < kPackets; ++packet) rays[packet] = photons[packet].ray;
    watch(rays, alive);
    scene_.intersect(rays, alive, points);
    for (std::size_t packet = 0; packet < kPackets; ++packet) {
      const unsigned shot = alive[packet];
      if (shot == 0) continue;
      part.rays += static_cast<std::uint64_t>(std::popcount(shot));
      part.lost += static_cast<std::uint64_t>(
          std::popcount(shot & ~points[packet].hits & lanes_of(photons[packet].bounce == 0)));
      alive[packet] = points[packet].hits == 0 ? 0 : scatter(numbers, points[packet], photons[packet], part);
      fill(packet, kAllLanes & ~alive[packet]);
    }
  }
}

PhotonBatch PhotonTracer::trace(std::uint64_t sub_pass) const {
  PhotonBatch all;
  if (flux_unit_ <= 0.0) return all;
  const std::uint32_t chunks = (options_.paths + kChunkPaths - 1) / kChunkPaths;
  std::vector<Part> parts(chunks);
  parallel_for(chunks, [&](std::size_t index) {
    const auto chunk = static_cast<std::uint32_t>(index);
    const std::uint32_t end = std::min(options_.paths, (chunk + 1) * kChunkPaths);
    trace_paths(sub_pass, chunk * kChunkPaths, end, parts[chunk], [](const auto&, const auto&) {});
  });
  for (std::size_t flow = 0; flow <= kFlows; ++flow) {
    Photons& joined = flow < kFlows ? all.flows[flow] : all.direct;
    std::vector<std::size_t> starts(chunks);
    std::size_t count = 0;
    for (std::uint32_t chunk = 0; chunk < chunks; ++chunk) {
      starts[chunk] = count;
      count += parts[chunk].flows[flow].size();
    }
    joined.resize(count);
    parallel_for(chunks, [&](std::size_t chunk) {
      Photons& photons = parts[chunk].flows[flow];
      std::copy(photons.begin(), photons.end(), joined.begin() + static_cast<std::ptrdiff_t>(starts[chunk]));
      photons = {};
    });
  }
  for (const Part& part : parts) {
    all.rays += part.rays;
    all.lost += part.lost;
    all.faults += part.faults;
  }
  return all;
}

std::vector<Ray> PhotonTracer::rays_of(std::uint64_t sub_pass) const {
  std::vector<Ray> all;
  for (std::uint32_t first = 0; first < options_.paths; first += kChunkPaths) {
    Part part;
    trace_paths(sub_pass, first, std::min(options_.paths, first + kChunkPaths), part,
                [&](const auto& rays, const auto& lanes) {
                  for (std::size_t packet = 0; packet < rays.size(); ++packet) {
                    for_each_lane(lanes[packet], [&](std::size_t lane) {
                      all.push_back({rays[packet].origin[lane], rays[packet].direction[lane]});
                    });
                  }
                });
  }
  return all;
}

}  // namespace pf
