#include "worker/photon/photon_tracer.h"

#include <algorithm>
#include <optional>
#include <span>
#include <vector>

#include "common/base/parallel.h"
#include "common/math/philox.h"
#include "worker/bsdf/lambert.h"
#include "worker/photon/photon_tree.h"
#include "worker/photon/projection_map.h"
#include "worker/scene/medium_stack.h"

namespace pf {
namespace {

/// Paths are cut into chunks of a fixed size, each with its own batch, joined in order.
constexpr std::uint32_t kChunk = 8192;

}  // namespace

/// A photon on its way.
struct PhotonTracer::Walk {
  PathRng rng{0, Stream::kPhoton, 0, 0};
  Vec3f position;  ///< of the lamp or of the last surface
  Rgb flux;        ///< in units of flux_unit()
  MediumStack media;
  int bounce = 0;
  bool specular_only = true;  ///< no diffuse bounce yet

  /// Whether the photon goes on after a bounce of this weight; its flux is then what goes on. Russian roulette on the largest
  /// channel keeps photons whole [Jensen 2001, 5.2.4].
  [[gnu::always_inline]] bool survives(const Rgb& weight) {
    const Rgb left = flux * weight;
    const float survival = std::min(1.0f, max_component(left) / max_component(flux));
    if (!(survival > 0.0f)) return false;
    if (survival < 1.0f) {
      if (rng.next1() >= survival) return false;
      flux = left / survival;
    } else {
      flux = left;
    }
    return true;
  }
  /// Sets `ray` to what leaves `point` towards `wi`; false when that is one bounce too many.
  [[gnu::always_inline]] bool follow(const SurfacePoint& point, const Vec3f& wi, int max_depth, Ray& ray) {
    position = point.position;
    ray.origin = offset_past(point, wi);
    ray.direction = wi;
    ++bounce;
    return max_depth == 0 || bounce < max_depth;
  }
};

PhotonTracer::PhotonTracer(const Scene& scene, const PhotonOptions& options)
    : scene_(scene),
      options_(options),
      flux_unit_(static_cast<double>(average(scene.lights().total_flux())) / options.paths),
      emitted_scale_(static_cast<float>(1.0 / (flux_unit_ * options.paths))) {}

/// Photons of some paths, a record each.
struct PhotonTracer::Part {
  std::array<std::vector<Photon>, kFlows + 1> flows;  ///< the last one: direct
  std::uint64_t rays = 0;
  std::uint64_t lost = 0;
  Faults faults;
};

void PhotonTracer::store(const Walk& walk, const SurfacePoint& point, const Vec3f& wo, const Vec3f& ng, const Vec3f& ns,
                         Part& part) const {
  Rgb flux = walk.flux;
  const float geometric = dot(wo, ng);
  const float shading = dot(wo, ns);
  if (geometric <= 0.0f || shading <= 0.0f) return;
  if (shading != geometric) flux *= shading / geometric;
  if (!is_finite(flux)) {
    ++part.faults.not_finite;
    return;
  }
  if (max_component(flux) > kMaxPhotonFlux) {
    ++part.faults.overflow;
    return;
  }
  const std::size_t flow = walk.bounce == 0 ? kFlows : walk.specular_only ? kCaustic : kIndirect;
  part.flows[flow].push_back(make_photon(point.position, flux, wo, ng));
}

bool PhotonTracer::emit(std::uint64_t sub_pass, std::uint32_t path, Walk& walk, Ray& ray) const {
  walk.rng = PathRng(options_.seed, Stream::kPhoton, sub_pass, path);
  const float u_light = walk.rng.next1();
  const Vec2f u_position = walk.rng.next2();
  const Vec2f u_direction = walk.rng.next2();
  const auto picked = options_.projection == nullptr ? scene_.lights().emit(u_light, u_position, u_direction)
                                                     : options_.projection->emit(u_light, u_position, u_direction);
  if (!picked) return false;
  ray = {picked->emission.origin, picked->emission.direction};
  walk.position = picked->emission.origin;  // of a lamp inside a medium set exactly below
  walk.flux = picked->emission.flux * emitted_scale_;
  walk.bounce = 0;
  walk.specular_only = true;
  walk.media = MediumStack();
  if (picked->triangle >= 0) {
    const auto index = static_cast<std::uint32_t>(picked->triangle);
    walk.flux *= scene_.emission_ratio(index, picked->barycentric);
    const std::span<const int> media = scene_.media_of_emitter(index);
    if (media.empty()) return max_component(walk.flux) > 0.0f;
    walk.media = MediumStack(media);
    const EmissiveTriangle& lamp = scene_.lights().triangle(index);
    const Vec2f& b = picked->barycentric;
    walk.position = lamp.p0 * (1.0f - b.x - b.y) + lamp.p1 * b.x + lamp.p2 * b.y;
  } else if (scene_.any_medium()) {
    walk.media = MediumStack(scene_.media_around(picked->emission.origin));
  }
  return max_component(walk.flux) > 0.0f;
}

bool PhotonTracer::scatter(Walk& walk, const SurfacePoint& point, Ray& ray, Part& part) const {
  if (!walk.media.empty())
    walk.flux *= walk.media.transmittance(scene_, length(point.position - walk.position));
  const Rgb* albedo = scene_.plain_lambert(point.material);
  if (albedo != nullptr) return scatter_lambert(walk, point, *albedo, ray, part);
  const SmoothMaterial* smooth = scene_.smooth_material(point.material);
  return smooth != nullptr ? scatter_smooth(walk, point, *smooth, ray, part) : scatter_any(walk, point, ray, part);
}

bool PhotonTracer::scatter_any(Walk& walk, const SurfacePoint& point, Ray& ray, Part& part) const {
  const Vec3f wo = -ray.direction;
  const bool entering = dot(wo, point.ng) > 0.0f;
  const Bsdf bsdf(scene_.evaluate(point, walk.media.eta_outside(scene_, point.material, entering)), wo);
  if (bsdf.is_black()) return false;
  if ((walk.bounce > 0 || options_.direct) && !bsdf.is_delta_only()) store(walk, point, wo, bsdf.ng(), bsdf.ns(), part);

  const float u_lobe = walk.rng.next1();
  const auto sample = bsdf.sample(wo, u_lobe, walk.rng.next2(), Transport::kFlux);
  if (!sample) return false;
  // A rough reflection counts as specular with the probability that it is followed rather than gathered.
  if (sample->specularity <= 0.0f ||
      (sample->specularity < 1.0f && walk.rng.next1() >= sample->specularity)) {
    walk.specular_only = false;
    if (options_.caustics_only) return false;
  }
  if (!walk.survives(sample->weight)) return false;
  if (sample->refracted) walk.media.cross(point.material, entering);
  return walk.follow(point, sample->wi, options_.max_depth, ray);
}

/// The same as scatter_any(), number for number, for mirrors and clear glass: nothing is stored there.
bool PhotonTracer::scatter_smooth(Walk& walk, const SurfacePoint& point, const SmoothMaterial& material, Ray& ray,
                                  Part& part) const {
  const Vec3f wo = -ray.direction;
  const bool entering = dot(wo, point.ng) > 0.0f;
  std::optional<Interface> room;
  const Interface* boundary = material.boundary(walk.media.eta_outside(scene_, point.material, entering), entering, room);
  if (boundary == nullptr) return scatter_any(walk, point, ray, part);
  const float u_lobe = walk.rng.next1();
  static_cast<void>(walk.rng.next2());  // the choice of a microfacet
  const auto sample = SmoothSurface(*boundary, material.thin(), point.ng, point.ns, wo).sample_flux(u_lobe);
  if (!sample || !walk.survives(sample->weight)) return false;
  if (sample->refracted) walk.media.cross(point.material, entering);
  return walk.follow(point, sample->wi, options_.max_depth, ray);
}

/// The same as scatter_any(), number for number, for the surfaces of most hits.
bool PhotonTracer::scatter_lambert(Walk& walk, const SurfacePoint& point, const Rgb& albedo, Ray& ray, Part& part) const {
  const Vec3f wo = -ray.direction;
  const LambertSurface surface(point.ng, point.ns, wo);
  if (!surface.seen() || is_zero(albedo)) return false;
  if (walk.bounce > 0 || options_.direct) store(walk, point, wo, surface.ng(), surface.ns(), part);
  if (options_.caustics_only) return false;
  static_cast<void>(walk.rng.next1());  // the choice of a lobe
  const LambertSample sample = surface.sample_flux(albedo, walk.rng.next2());
  if (!sample.valid) return false;
  walk.specular_only = false;
  return walk.survives(sample.weight) && walk.follow(point, sample.wi, options_.max_depth, ray);
}

template <typename Watch>
void PhotonTracer::trace_paths(std::uint64_t sub_pass, std::uint32_t first, std::uint32_t end, Part& part,
                               Watch&& watch) const {
  // Several photons take turns, a bounce each: what one waits for in memory the next have already asked for.
  constexpr std::size_t kLanes = 32;
  std::vector<Walk> walks(kLanes);
  std::array<Ray, kLanes> rays;
  std::array<std::optional<SurfacePoint>, kLanes> points;
  std::uint32_t next = first;
  const auto start = [&](std::size_t lane) {
    while (next < end) {
      if (emit(sub_pass, next++, walks[lane], rays[lane])) return true;
    }
    return false;
  };
  std::size_t alive = 0;
  while (alive < kLanes && start(alive)) ++alive;
  while (alive > 0) {
    const std::span<const Ray> shot(rays.data(), alive);
    watch(shot);
    part.rays += alive;
    scene_.intersect(shot, points);
    for (std::size_t lane = alive; lane-- > 0;) {
      if (points[lane]) {
        if (scatter(walks[lane], *points[lane], rays[lane], part)) continue;
      } else {
        part.lost += walks[lane].bounce == 0 ? 1 : 0;
      }
      if (start(lane)) continue;
      // No path is left to start: the last lane, already done with this turn, moves here.
      --alive;
      walks[lane] = walks[alive];
      rays[lane] = rays[alive];
    }
  }
}

PhotonBatch PhotonTracer::trace(std::uint64_t sub_pass) const {
  PhotonBatch all;
  if (flux_unit_ <= 0.0) return all;
  const std::uint32_t chunks = (options_.paths + kChunk - 1) / kChunk;
  std::vector<Part> parts(chunks);
  parallel_for(chunks, [&](std::size_t index) {
    const auto chunk = static_cast<std::uint32_t>(index);
    const std::uint32_t end = std::min(options_.paths, (chunk + 1) * kChunk);
    trace_paths(sub_pass, chunk * kChunk, end, parts[chunk], [](std::span<const Ray>) {});
  });
  for (std::size_t flow = 0; flow <= kFlows; ++flow) {
    PhotonArrays& joined = flow < kFlows ? all.flows[flow] : all.direct;
    std::vector<std::size_t> starts(chunks);
    std::size_t count = 0;
    for (std::uint32_t chunk = 0; chunk < chunks; ++chunk) {
      starts[chunk] = count;
      count += parts[chunk].flows[flow].size();
    }
    joined.resize(count);
    parallel_for(chunks, [&](std::size_t chunk) {
      std::vector<Photon>& photons = parts[chunk].flows[flow];
      for (std::size_t i = 0; i < photons.size(); ++i) joined.set(starts[chunk] + i, photons[i]);
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
  for (std::uint32_t first = 0; first < options_.paths; first += kChunk) {
    Part part;
    trace_paths(sub_pass, first, std::min(options_.paths, first + kChunk), part,
                [&](std::span<const Ray> rays) { all.insert(all.end(), rays.begin(), rays.end()); });
  }
  return all;
}

}  // namespace pf
