#include "worker/integrators/direct_light.h"

#include <algorithm>

#include "common/math/offset.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

/// Segment from the vertex to the light sample, both ends moved off their surfaces.
Ray shadow_ray(const Scene& scene, const Vertex& vertex, const Lights::Picked& picked) {
  const LightSample& light = picked.sample;
  const Vec3f origin = offset_past(vertex.point, light.wi);
  if (std::isinf(light.distance)) return {origin, light.wi, kInfinity};
  Vec3f target = vertex.point.position + light.wi * light.distance;
  if (picked.triangle >= 0) {
    const EmissiveTriangle& e = scene.lights().triangle(static_cast<std::uint32_t>(picked.triangle));
    const float extent = std::max(max_magnitude(e.p0), std::max(max_magnitude(e.p1), max_magnitude(e.p2)));
    target = offset_ray_origin(target, e.ng, -light.wi, extent);
  }
  return {origin, target - origin, 1.0f};
}

/// Digits of k in this base, mirrored at the point [Halton 1960]: any consecutive k lie far apart.
float mirrored_digits(int k, int base) {
  float value = 0.0f;
  for (float digit = 1.0f / static_cast<float>(base); k > 0; k /= base, digit /= static_cast<float>(base))
    value += digit * static_cast<float>(k % base);
  return value;
}

/// Of [0, 2) into [0, 1).
float wrapped(float u) { return u >= 1.0f ? u - 1.0f : u; }

}  // namespace

Rgb direct_light(const Scene& scene, const Vertex& vertex, const MediumStack& media, float u_pick, const Vec2f& u,
                 Portion followed, float follow_probability, std::uint64_t& rays) {
  const Bsdf& bsdf = vertex.bsdf;
  const auto picked = scene.lights().sample(vertex.point.position, bsdf.ns(), vertex.transmissive, u_pick, u);
  if (!picked) return {0.0f, 0.0f, 0.0f};
  const LightSample& light = picked->sample;
  const Rgb f = bsdf.eval(vertex.wo, light.wi, Transport::kRadiance);
  if (is_zero(f)) return f;
  Rgb radiance = light.radiance;
  if (picked->triangle >= 0) {
    radiance *= scene.emission_ratio(static_cast<std::uint32_t>(picked->triangle), picked->barycentric);
  }
  radiance *= f * (std::abs(dot(light.wi, bsdf.ns())) / light.pdf_w);
  if (is_zero(radiance)) return radiance;
  ++rays;
  if (scene.occluded(shadow_ray(scene, vertex, *picked))) return {0.0f, 0.0f, 0.0f};
  // A segment that leaves a volume through its surface is occluded by it: all of this one lies in one medium.
  if (!media.empty() && !std::isinf(light.distance)) radiance *= media.transmittance(scene, light.distance);
  if (light.delta || follow_probability <= 0.0f) return radiance;
  const float pdf_follow = follow_probability * bsdf.pdf(vertex.wo, light.wi, Transport::kRadiance, followed);
  return radiance * power_heuristic(light.pdf_w, pdf_follow);
}

Rgb direct_light(const Scene& scene, const Vertex& vertex, const MediumStack& media, float u_pick, const Vec2f& u,
                 Portion followed, float follow_probability, int samples, std::uint64_t& rays) {
  const float share = 1.0f / static_cast<float>(samples);
  Rgb sum{0.0f, 0.0f, 0.0f};
  for (int k = 0; k < samples; ++k) {
    const float pick = std::min((u_pick + static_cast<float>(k)) * share, kOneMinusEpsilon);
    const Vec2f at{wrapped(u.x + mirrored_digits(k, 2)), wrapped(u.y + mirrored_digits(k, 3))};
    sum += direct_light(scene, vertex, media, pick, at, followed, follow_probability, rays);
  }
  return sum * share;
}

float emitter_weight(const Scene& scene, const SurfacePoint& point, const BsdfTechnique& technique) {
  if (technique.delta) return 1.0f;
  const std::int32_t index = scene.emissive_triangle(point);
  if (index < 0) return 1.0f;
  const float pdf_light = scene.lights().pdf_w(technique.position, technique.normal, technique.transmissive,
                                               static_cast<std::uint32_t>(index), point.position);
  return power_heuristic(technique.pdf_w, pdf_light);
}

float environment_weight(const Scene& scene, const Vec3f& d, const BsdfTechnique& technique) {
  if (technique.delta) return 1.0f;
  const float pdf_light =
      scene.lights().pdf_w_environment(technique.position, technique.normal, technique.transmissive, d);
  return power_heuristic(technique.pdf_w, pdf_light);
}

}  // namespace pf
