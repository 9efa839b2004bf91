#include "worker/photon/photon_rays.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/math/frame.h"
#include "worker/photon/photon_numbers.h"
#include "worker/photon/photon_path.h"

namespace pf {
namespace {

/// Relative to the coordinates: where shape_around() looks. Rounding of positions is a thousandth of it.
constexpr float kProbe = 0x1p-12f;

RayKernel::Plane plane_of(const SurfacePoint& point, const Vec3f& side) {
  const Vec3f normal = dot(point.ng, side) < 0.0f ? -point.ng : point.ng;
  return {normal, dot(normal, point.position)};
}

}  // namespace

/// A photon on its way.
struct PhotonRays::Walk {
  PhotonNumbers numbers;
  std::uint32_t path = 0;
  Ray ray{{0, 0, 0}, {0, 0, 1}};
  Vec3f position{0, 0, 0};  ///< of the lamp or of the last surface
  Rgb flux{0, 0, 0};        ///< [W]
  MediumStack media;
  PhotonDifferential differential;
  RayKernel::Plane start;
  float share = 1;
  int bounce = 0;
  bool specular_only = true;
};

PhotonRays::PhotonRays(const Scene& scene, const PhotonOptions& options, bool differentials)
    : scene_(scene),
      options_(options),
      differentials_(differentials),
      scene_radius_(0.5f * length(scene.bounds().size())) {
  find_shares();
}

void PhotonRays::find_shares() {
  const Lights& lights = scene_.lights();
  const std::size_t triangles = lights.triangle_count();
  const std::size_t count = lights.punctual_count() + (scene_.environment().present() ? 1 : 0);
  const auto emitted = [&](float u, const Vec2f& u_position, const Vec2f& u_direction) {
    return lights.emit(u, u_position, u_direction)->emission;
  };
  if (!lights.emit(0.5f, {0.5f, 0.5f}, {0.5f, 0.5f})) return;
  // Lights are picked in their order as u grows: the u where a light begins is found by halving.
  const auto begin_of = [&](std::size_t light) {
    float low = 0.0f, high = 1.0f;
    for (int i = 0; i < 24; ++i) {
      const float middle = 0.5f * (low + high);
      const auto found = static_cast<std::size_t>(emitted(middle, {0.5f, 0.5f}, {0.5f, 0.5f}).light);
      (found >= triangles && found >= light ? high : low) = middle;
    }
    return high;
  };
  for (std::size_t i = 0; i < count; ++i) {
    Distant lamp;
    const float begin = begin_of(triangles + i);
    const float end = i + 1 < count ? begin_of(triangles + i + 1) : 1.0f;
    lamp.share = end - begin;
    const float u = 0.5f * (begin + end);
    if (lamp.share > 0.0f && u < 1.0f) {
      const Emission one = emitted(u, {0.3f, 0.3f}, {0.0f, 0.3f});
      const Emission other = emitted(u, {0.8f, 0.7f}, {0.8f, 0.7f});
      lamp.directional = one.direction == other.direction && one.origin != other.origin;
      lamp.axis = one.direction;
    }
    distant_.push_back(lamp);
  }
}

void PhotonRays::spread_of_emission(const Lights::EmissionPicked& picked, float u_light, const Vec2f& u_position,
                                    const Vec2f& u_direction, Walk& walk) const {
  const Vec3f& d = picked.emission.direction;
  if (picked.triangle >= 0) {
    // Emitted flux is Le cos / pdf with pdf_w = cos / pi [Lights::emit]: what is left is the density of the place.
    const EmissiveTriangle& lamp = scene_.lights().triangle(static_cast<std::uint32_t>(picked.triangle));
    const float pdf_a = kPi * average(lamp.radiance) / average(picked.emission.flux);
    const float pdf_w = std::abs(dot(d, lamp.ng)) * kInvPi;
    walk.differential = PhotonDifferential::emitted(d, lamp.ng, pdf_a, pdf_w);
    walk.share = 1.0f;
    return;
  }
  const std::size_t index = picked.emission.light - scene_.lights().triangle_count();
  const Distant& lamp = distant_[index];
  walk.share = std::max(lamp.share, 1e-6f);
  const bool environment = index >= scene_.lights().punctual_count();
  if (environment || lamp.directional) {
    const float pdf_w = environment ? scene_.environment().pdf_w(-d) : kInfinity;
    walk.differential = PhotonDifferential::emitted(d, d, 1.0f / (kPi * scene_radius_ * scene_radius_), pdf_w);
    // Discs of all directions have one centre: there another direction is no other place.
    walk.differential.advance(-dot(scene_.bounds().center() - picked.emission.origin, d));
    return;
  }
  // A point or spot light: uniform around its axis, so that the density follows from how the cosine grows with u.x.
  constexpr float kStep = 0x1p-10f;
  const float step = u_direction.x < 0.5f ? kStep : -kStep;
  const auto beside = scene_.lights().emit(u_light, u_position, {u_direction.x + step, u_direction.y});
  const float change = beside ? std::abs(dot(beside->emission.direction - d, lamp.axis)) : 0.0f;
  walk.differential = PhotonDifferential::emitted(d, d, kInfinity, kStep / (2.0f * kPi * std::max(change, 1e-7f)));
}

bool PhotonRays::emit(std::uint64_t sub_pass, std::uint32_t path, Walk& walk) const {
  walk = Walk();
  walk.numbers = {options_.seed, sub_pass};
  walk.path = path;
  const auto u = walk.numbers.draw(path, 0), more = walk.numbers.draw(path, 1);
  const auto picked = scene_.lights().emit(u[0], {u[1], u[2]}, {u[3], more[0]});
  if (!picked) return false;
  walk.ray = {picked->emission.origin, picked->emission.direction};
  PhotonStart start = photon_start(scene_, picked->emission.origin, picked->triangle, picked->barycentric);
  walk.position = start.position;
  walk.media = start.media;
  walk.flux = picked->emission.flux / static_cast<float>(options_.paths) * start.texture;
  if (!(max_component(walk.flux) > 0.0f)) return false;
  spread_of_emission(*picked, u[0], {u[1], u[2]}, {u[3], more[0]}, walk);
  return true;
}

void PhotonRays::spread_of_scattering(Walk& walk, const SurfacePoint& point, const Bsdf& bsdf,
                                      const SurfaceParams& params, const BsdfSample& sample) const {
  PhotonDifferential& differential = walk.differential;
  if (sample.specularity <= 0.0f) {
    differential.bounce(bsdf.ng(), sample.wi, sample.pdf_w);
    return;
  }
  const Vec3f wo = -walk.ray.direction;
  const bool entering = dot(wo, point.ng) > 0.0f;
  const float outside = params.eta_outside;
  const float eta_i = entering ? outside : params.ior;
  const float eta_t = entering ? params.ior : outside;
  // What mirrored or refracted: the normal between both directions, of a rough surface its microfacet's.
  Vec3f half = sample.transmitted ? wo * eta_i + sample.wi * eta_t : wo + sample.wi;
  const bool straight = sample.transmitted && (!sample.refracted || eta_i == eta_t);
  if (!differentials_ || straight || !(length2(half) > 1e-8f)) {
    differential.turn(sample.wi);
  } else {
    half = normalize(half);
    if (dot(half, point.ng) < 0.0f) half = -half;
    const SurfaceShape shape = shape_around(scene_, point);
    if (sample.transmitted) {
      differential.refract(point.ng, half, shape, eta_i, eta_t, sample.wi);
    } else {
      differential.reflect(point.ng, half, shape, sample.wi);
    }
  }
  if (!sample.delta) differential.roughen(sample.pdf_w);
}

bool PhotonRays::scatter(Walk& walk, const SurfacePoint& point) const {
  const float distance = length(point.position - walk.position);
  if (!walk.media.empty()) walk.flux *= walk.media.transmittance(scene_, distance);
  walk.differential.advance(distance);
  const Vec3f wo = -walk.ray.direction;
  const bool entering = dot(wo, point.ng) > 0.0f;
  const SurfaceParams params = scene_.evaluate(point, walk.media.eta_outside(scene_, point.material, entering));
  const Bsdf bsdf(params, wo);
  if (bsdf.is_black()) return false;
  const auto u = walk.numbers.draw(walk.path, PhotonNumbers::block_of(walk.bounce));
  const auto sample = bsdf.sample(wo, u[0], {u[1], u[2]}, Transport::kFlux);
  if (!sample) return false;
  // A rough reflection counts as specular with the probability that it is followed rather than gathered.
  if (sample->specularity <= 0.0f ||
      (sample->specularity < 1.0f && walk.numbers.late(walk.path, walk.bounce) >= sample->specularity)) {
    walk.specular_only = false;
  }
  const float survival = roulette(walk.flux, sample->weight, u[3]);
  if (!(survival > 0.0f)) return false;
  walk.share *= survival;
  spread_of_scattering(walk, point, bsdf, params, *sample);
  if (sample->refracted) walk.media.cross(point.material, entering);
  walk.start = plane_of(point, sample->wi);
  walk.position = point.position;
  walk.ray = {offset_past(point, sample->wi), sample->wi};
  ++walk.bounce;
  return options_.max_depth == 0 || walk.bounce < options_.max_depth;
}

float PhotonRays::exit_distance(const Vec3f& origin, const Vec3f& direction) const {
  const Box3f& box = scene_.bounds();
  float exit = kInfinity;
  for (int k = 0; k < 3; ++k) {
    if (direction[k] == 0.0f) continue;
    exit = std::min(exit, ((direction[k] > 0.0f ? box.max[k] : box.min[k]) - origin[k]) / direction[k]);
  }
  return std::isfinite(exit) ? std::max(0.0f, exit) : 0.0f;
}

void PhotonRays::trace(std::uint64_t sub_pass, std::uint32_t first, std::uint32_t end,
                       std::vector<PhotonSegment>& segments, Figures& figures) const {
  for (std::uint32_t path = first; path < end; ++path) {
    Walk walk;
    if (!emit(sub_pass, path, walk)) continue;
    do {
      ++figures.rays;
      const auto hit = scene_.intersect(walk.ray);
      if (!is_finite(walk.flux)) {
        ++figures.faults.not_finite;
        break;
      }
      if (walk.bounce > 0) {
        const float to_end =
            hit ? length(hit->position - walk.position) : exit_distance(walk.position, walk.ray.direction);
        segments.push_back({walk.position, walk.ray.direction, to_end, walk.flux,
                            walk.specular_only ? kCaustic : kIndirect, walk.share, walk.differential, walk.media,
                            walk.start, hit ? plane_of(*hit, -walk.ray.direction) : RayKernel::Plane{}});
      }
      if (!hit || !scatter(walk, *hit)) break;
    } while (true);
  }
}

SurfaceShape shape_around(const Scene& scene, const SurfacePoint& point) {
  SurfaceShape shape;
  const Frame frame = Frame::from_normal(point.ng);
  shape.tangent_x = frame.t;
  shape.tangent_y = frame.b;
  if (point.ns == point.ng) return shape;
  const float step = kProbe * std::max(point.extent, max_magnitude(point.position));
  const auto change_along = [&](const Vec3f& tangent) {
    for (const float side : {step, -step}) {
      const Vec3f above = point.position + tangent * side + point.ng * step;
      const auto beside = scene.intersect({above, -point.ng, 3.0f * step});
      if (!beside || beside->placement != point.placement || dot(beside->ng, point.ng) < 0.5f) continue;
      const float moved = dot(beside->position - point.position, tangent);
      if (std::abs(moved) < 0.5f * step) continue;
      const Vec3f change = beside->ns - point.ns;
      return (change - point.ns * dot(change, point.ns)) / moved;
    }
    return Vec3f(0.0f);
  };
  shape.normal_by_x = change_along(shape.tangent_x);
  shape.normal_by_y = change_along(shape.tangent_y);
  return shape;
}

RayKernel kernel_of(const PhotonSegment& segment, std::uint32_t paths, const KernelRule& rule) {
  const Frame frame = Frame::from_normal(segment.direction);
  PhotonDifferential::Along along = segment.differential.along(frame.t, frame.b);
  if (!rule.ellipse) {
    for (Spread* s : {&along.at_start, &along.linear, &along.quadratic}) {
      const float mean = 0.5f * (s->xx + s->yy);
      *s = {mean, 0.0f, mean};
    }
  }
  const float per_path = rule.photons / (kPi * static_cast<float>(paths) * segment.share);
  float scale = per_path * rule.smoothing * rule.smoothing;
  const auto widest2 = [&](float t) {
    return (along.at_start + along.linear * t + along.quadratic * (t * t)).largest();
  };
  const float largest2 = std::max(widest2(0.0f), widest2(segment.length)) * scale;
  if (largest2 > rule.widest * rule.widest) scale *= rule.widest * rule.widest / largest2;
  return RayKernel(segment.origin, segment.direction, segment.length, frame.t, frame.b, along.at_start * scale,
                   along.linear * scale, along.quadratic * scale, segment.start, segment.end);
}

}  // namespace pf
