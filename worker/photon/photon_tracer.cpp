#include "worker/photon/photon_tracer.h"

#include <algorithm>
#include <bit>
#include <optional>
#include <span>
#include <vector>

#include "common/base/parallel.h"
#include "common/spec/job_spec.h"
#include "worker/bsdf/lambert_lanes.h"
#include "worker/bsdf/smooth_lanes.h"
#include "worker/photon/photon_lanes.h"
#include "worker/photon/photon_path.h"
#include "worker/photon/photon_pool.h"
#include "worker/photon/photon_tree.h"
#include "worker/photon/projection_map.h"

namespace pf {
namespace {

/// Paths are cut into chunks of a fixed size, each with its own batch, joined in order.
constexpr std::uint32_t kChunkPaths = 8192;

/// Whether all paths start in air and carry what their lamp emits in its mean.
bool starts_alike(const Scene& scene) {
  if (scene.emission_varies()) return false;
  if (!scene.any_medium()) return true;
  const Lights& lights = scene.lights();
  if (lights.punctual_count() > 0 || scene.environment().present()) return false;
  for (std::uint32_t i = 0; i < lights.triangle_count(); ++i) {
    if (!scene.media_of_emitter(i).empty()) return false;
  }
  return true;
}

}  // namespace

/// One photon of eight, where the surface decides what happens to it.
struct PhotonTracer::Walk {
  const PhotonNumbers& numbers;
  std::array<float, 4> u;  ///< of this bounce: lobe, direction, roulette
  WalkingPhoton photon;

  /// Whether the photon goes on after a bounce of this weight; its flux is then what goes on.
  [[gnu::always_inline]] bool survives(const Rgb& weight) { return roulette(photon.flux, weight, u[3]) > 0.0f; }
  /// Sends the photon from `point` towards `wi`.
  [[gnu::always_inline]] void follow(const SurfacePoint& point, const Vec3f& wi) {
    photon.ray.origin = offset_past(point, wi);
    photon.ray.direction = wi;
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
    matte_.push_back(albedo == nullptr ? Matte{} : Matte{albedo->x, albedo->y, albedo->z, 1.0f});
  }
  lamps_alike_ = starts_alike(scene);
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

void PhotonTracer::emit(const PhotonNumbers& numbers, std::uint32_t first, EmissionLanes& emissions) const {
  const Uint8 paths = Uint8{0, 1, 2, 3, 4, 5, 6, 7} + first;
  const auto u = numbers.draw(paths, Uint8{}), more = numbers.draw(paths, Uint8{} + 1u);
  if (guided()) return emit_guided(u, more[0], emissions);
  if (options_.projection == nullptr)
    return scene_.lights().emit(u[0], {u[1], u[2]}, {u[3], more[0]}, !lamps_alike_, emissions);
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
  scene_.lights().emit(u[0], {u[1], u[2]}, {u[3], last}, !lamps_alike_, emissions);
  emissions.flux = emissions.flux * weight;
}

EmissionGuide::Drawn PhotonTracer::emission(std::uint64_t sub_pass, std::uint32_t path) const {
  const PhotonNumbers numbers{options_.seed, sub_pass};
  const auto u = numbers.draw(path, 0);
  const EmissionGuide::Numbers all{u[0], u[1], u[2], u[3], numbers.draw(path, 1)[0]};
  return options_.guide == nullptr ? EmissionGuide::Drawn{all, 1.0f} : options_.guide->draw(all);
}

void PhotonTracer::start(const PhotonNumbers& numbers, std::uint32_t first, std::uint32_t end, PhotonPool& pool) const {
  EmissionLanes emissions;
  emit(numbers, first, emissions);
  PhotonLanes photons;
  photons.ray = {emissions.origin, emissions.direction};
  photons.position = emissions.origin;
  photons.flux = emissions.flux * all(emitted_scale_);
  photons.path = Uint8{0, 1, 2, 3, 4, 5, 6, 7} + first;
  photons.bounce = Int8{};
  photons.specular_only = Int8{} - 1;
  unsigned lanes = emissions.lanes;
  if (end - first < kLanes) lanes &= (1u << (end - first)) - 1;
  if (!lamps_alike_) {
    for_each_lane(lanes, [&](std::size_t lane) {
      const PhotonStart begins =
          photon_start(scene_, emissions.origin[lane], emissions.triangle[lane], emissions.barycentric[lane]);
      photons.position.set(lane, begins.position);
      photons.flux.set(lane, photons.flux[lane] * begins.texture);
      photons.media[lane] = begins.media;
    });
  }
  pool.add(lanes & lanes_of(max_component(photons.flux) > 0.0f), photons);
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

void PhotonTracer::scatter(const PhotonNumbers& numbers, const SurfaceLanes& points, PhotonLanes& photons,
                           PhotonPool& pool, Part& part) const {
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
  const auto [albedo, lambert] = matte(points);
  const unsigned deep = options_.max_depth == 0 ? 0 : lanes_of(photons.bounce >= options_.max_depth - 1);
  unsigned on = lambert == 0 ? 0 : scatter_lambert(lambert, albedo, points, u, photons, arrivals);
  const unsigned others = points.hits & ~lambert;
  const unsigned smooth = others == 0 ? 0 : scatter_smooth(others, points, u, photons, on);
  photons.bounce += 1;
  // All at once: what waits in the pool is overwritten if eight are added before eight were taken.
  pool.add(on & ~deep, photons);
  for_each_lane(others & ~smooth, [&](std::size_t lane) {
    Walk walk{numbers,
              {u[0][lane], u[1][lane], u[2][lane], u[3][lane]},
              {{photons.ray.origin[lane], photons.ray.direction[lane]},
               photons.position[lane],
               photons.flux[lane],
               photons.path[lane],
               photons.bounce[lane],
               photons.specular_only[lane] != 0,
               photons.media[lane]}};
    if (scatter_any(walk, points.point(lane), lane, arrivals) && (deep >> lane & 1u) == 0) pool.add(walk.photon);
  });
  if (!options_.direct) arrivals.lanes &= ~lanes_of(arrivals.bounce == 0);
  if (arrivals.lanes != 0) store(arrivals, part);
}

/// Albedo of the plain Lambert reflectors among the surfaces, and their lanes.
std::pair<Vec3x8, unsigned> PhotonTracer::matte(const SurfaceLanes& points) const {
  std::array<Float8, 4> rows;  // of lane i and lane i + 4
  const auto of_lane = [&](std::size_t lane) {
    const int material = (points.hits >> lane & 1u) != 0 ? points.material[lane] : 0;
    return _mm_load_ps(&matte_[static_cast<std::size_t>(material)].red);
  };
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i] = _mm256_set_m128(of_lane(i + 4), of_lane(i));
  const Float8 xy = _mm256_unpacklo_ps(rows[0], rows[1]), xy2 = _mm256_unpacklo_ps(rows[2], rows[3]);
  const Float8 zw = _mm256_unpackhi_ps(rows[0], rows[1]), zw2 = _mm256_unpackhi_ps(rows[2], rows[3]);
  const Vec3x8 albedo{_mm256_shuffle_ps(xy, xy2, 0x44), _mm256_shuffle_ps(xy, xy2, 0xEE),
                      _mm256_shuffle_ps(zw, zw2, 0x44)};
  const Float8 plain = _mm256_shuffle_ps(zw, zw2, 0xEE);
  return {albedo, points.hits & lanes_of(plain != 0.0f)};
}

bool PhotonTracer::scatter_any(Walk& walk, const SurfacePoint& point, std::size_t lane, Arrivals& arrivals) const {
  const Vec3f wo = -walk.photon.ray.direction;
  const bool entering = dot(wo, point.ng) > 0.0f;
  const Bsdf bsdf(scene_.evaluate(point, walk.photon.media.eta_outside(scene_, point.material, entering)), wo);
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
      (sample->specularity < 1.0f &&
       walk.numbers.late(walk.photon.path, walk.photon.bounce - 1) >= sample->specularity)) {
    walk.photon.specular_only = false;
    if (options_.caustics_only) return false;
  }
  if (!walk.survives(sample->weight)) return false;
  if (sample->refracted) walk.photon.media.cross(point.material, entering);
  walk.follow(point, sample->wi);
  return true;
}

/// The same as scatter_any(), number for number, for mirrors and clear glass: nothing is stored there.
unsigned PhotonTracer::scatter_smooth(unsigned lanes, const SurfaceLanes& points, const std::array<Float8, 4>& u,
                                      PhotonLanes& photons, unsigned& on) const {
  const Vec3x8 wo = -photons.ray.direction;
  const unsigned entering = lanes_of(dot(wo, points.ng) > 0.0f);
  std::array<const Interface*, kLanes> boundaries{};
  std::array<std::optional<Interface>, kLanes> rooms;
  unsigned smooth = 0;
  for_each_lane(lanes, [&](std::size_t lane) {
    const SmoothMaterial* material = scene_.smooth_material(points.material[lane]);
    if (material == nullptr) return;
    const bool enters = (entering >> lane & 1u) != 0;
    const float outside = photons.media[lane].eta_outside(scene_, points.material[lane], enters);
    boundaries[lane] = material->boundary(outside, enters, rooms[lane]);
    smooth |= boundaries[lane] != nullptr ? 1u << lane : 0;
  });
  if (smooth == 0) return 0;
  const Interface* any = boundaries[static_cast<std::size_t>(std::countr_zero(smooth))];
  std::ranges::replace(boundaries, nullptr, any);
  const InterfaceLanes boundary(boundaries);
  const SmoothLanes::Sample sample = SmoothLanes(boundary, points.ng, points.ns, wo).sample_flux(u[0]);
  const unsigned going = follow(mask_of(smooth) & sample.valid, sample.wi, sample.weight, u[3], points, photons);
  for_each_lane(going & lanes_of(sample.refracted), [&](std::size_t lane) {
    photons.media[lane].cross(points.material[lane], (entering >> lane & 1u) != 0);
  });
  on |= going;
  return smooth;
}

/// Walk::survives() and Walk::follow() in the lanes of `mask`; returns those that go on.
unsigned PhotonTracer::follow(const Int8& mask, const Vec3x8& wi, const Vec3x8& weight, const Float8& u,
                              const SurfaceLanes& points, PhotonLanes& photons) {
  const Vec3x8 left = photons.flux * weight;
  const Float8 survival = min(all(1.0f), max_component(left) / max_component(photons.flux));
  const Int8 on = mask & (u < survival);
  photons.flux = select(on, select(survival < 1.0f, left / survival, left), photons.flux);
  photons.ray.origin = select(on, offset_ray_origin(points.position, points.ng, wi, points.extent), photons.ray.origin);
  photons.ray.direction = select(on, wi, photons.ray.direction);
  return lanes_of(on);
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
  const unsigned on = follow(here & sample.valid, sample.wi, sample.weight, u[3], points, photons);
  photons.specular_only = mask_of(on) ? Int8{} : photons.specular_only;
  return on;
}

template <typename Watch>
void PhotonTracer::trace_paths(std::uint64_t sub_pass, std::uint32_t first, std::uint32_t end, Part& part,
                               Watch&& watch) const {
  // Several packets take turns: what one waits for in memory the next have already asked for.
  constexpr std::size_t kPackets = 4;
  const PhotonNumbers numbers{options_.seed, sub_pass};
  PhotonPool pool(scene_.any_medium());
  std::vector<PhotonLanes> photons(kPackets);
  std::vector<SurfaceLanes> points(kPackets);
  std::array<RayLanes, kPackets> rays;
  std::array<unsigned, kPackets> alive{};
  while (first < end || pool.size() != 0) {
    for (; first < end && pool.has_room(); first += std::min<std::uint32_t>(kLanes, end - first))
      start(numbers, first, end, pool);
    const std::size_t waiting = pool.size();
    pool.refill();
    for (std::size_t taken = 0; taken < waiting;) {
      for (std::size_t packet = 0; packet < kPackets; ++packet) {
        const std::size_t count = std::min<std::size_t>(kLanes, waiting - taken);
        alive[packet] = (1u << count) - 1;
        if (count == 0) continue;
        pool.take(taken, photons[packet]);
        rays[packet] = photons[packet].ray;
        taken += count;
      }
      watch(rays, alive);
      scene_.intersect(rays, alive, points);
      for (std::size_t packet = 0; packet < kPackets; ++packet) {
        const unsigned shot = alive[packet], hits = points[packet].hits;
        part.rays += static_cast<std::uint64_t>(std::popcount(shot));
        part.lost += static_cast<std::uint64_t>(std::popcount(shot & ~hits & lanes_of(photons[packet].bounce == 0)));
        if (hits != 0) scatter(numbers, points[packet], photons[packet], pool, part);
      }
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
