#include <bit>
#include <cstddef>

#include "worker/scene/embree_scene.h"

namespace pf {
namespace {

Vec3x8 interpolate(const Vec3x8& a, const Vec3x8& b, const Vec3x8& c, const Float8& b1, const Float8& b2) {
  return a * (1.0f - b1 - b2) + b * b1 + c * b2;
}

}  // namespace

void Scene::Embree::intersect(const RayLanes& rays, unsigned lanes, SurfaceLanes& met) const {
  RTCRayHit8 packet;
  const auto set = [](float* to, const Float8& values) { _mm256_store_ps(to, values); };
  const auto set_all = [](unsigned* to, unsigned value) {
    _mm256_store_si256(reinterpret_cast<__m256i*>(to), _mm256_set1_epi32(static_cast<int>(value)));
  };
  set(packet.ray.org_x, rays.origin.x), set(packet.ray.org_y, rays.origin.y), set(packet.ray.org_z, rays.origin.z);
  set(packet.ray.dir_x, rays.direction.x), set(packet.ray.dir_y, rays.direction.y),
      set(packet.ray.dir_z, rays.direction.z);
  set(packet.ray.tnear, Float8{}), set(packet.ray.time, Float8{}), set(packet.ray.tfar, rays.t_max);
  set_all(packet.ray.mask, ~0u), set_all(packet.ray.id, 0), set_all(packet.ray.flags, 0);
  set_all(packet.hit.geomID, RTC_INVALID_GEOMETRY_ID), set_all(packet.hit.instID[0], RTC_INVALID_GEOMETRY_ID);
  alignas(32) int valid[kLanes];
  _mm256_store_si256(reinterpret_cast<__m256i*>(valid), reinterpret_cast<__m256i>(mask_of(lanes)));
  embree_intersect(valid, top.get(), packet, rays.alike);

  const auto ids = [](const unsigned* from) {
    return reinterpret_cast<Uint8>(_mm256_load_si256(reinterpret_cast<const __m256i*>(from)));
  };
  const Uint8 geometry = ids(packet.hit.geomID), instance = ids(packet.hit.instID[0]);
  const auto keep = [](std::array<std::uint32_t, kLanes>& to, const Uint8& values) {
    _mm256_store_si256(reinterpret_cast<__m256i*>(to.data()), reinterpret_cast<__m256i>(values));
  };
  keep(met.placement, instance == RTC_INVALID_GEOMETRY_ID ? geometry : instance);
  keep(met.primitive, ids(packet.hit.primID));
  met.hits = lanes & lanes_of(geometry != RTC_INVALID_GEOMETRY_ID);
  met.t = _mm256_load_ps(packet.ray.tfar);
  met.b1 = _mm256_load_ps(packet.hit.u);
  met.b2 = _mm256_load_ps(packet.hit.v);
}

void Scene::intersect(std::span<const RayLanes> rays, std::span<const unsigned> lanes,
                      std::span<SurfaceLanes> points) const {
  for (std::size_t i = 0; i < rays.size(); ++i) {
    SurfaceLanes& met = points[i];
    met.hits = 0;
    if (lanes[i] == 0) continue;
    embree_->intersect(rays[i], lanes[i], met);
    for_each_lane(met.hits, [&](std::size_t lane) {
      const PlacedTriangles& placed = placed_[met.placement[lane]];
      met.material[lane] = placed.material;
      met.triangle[lane] = placed.flat + met.primitive[lane];
      __builtin_prefetch(met.triangle[lane]);
      if (placed.normals == nullptr) return;
      __builtin_prefetch(&placed.normals[met.primitive[lane]][0]);
      __builtin_prefetch(&placed.normals[met.primitive[lane]][2].z);
    });
  }
  for (SurfaceLanes& point : points) {
    if (point.hits != 0) find_points(point);
  }
}

void Scene::find_points(SurfaceLanes& points) const {
  static_assert(sizeof(Triangle) == 64 && offsetof(Triangle, ng) == 36 && offsetof(Triangle, extent) == 48);
  std::array<Float8, kLanes> low, high;  // of a triangle's sixteen floats
  // Lanes that met nothing read another's triangle: their values are not used.
  const void* any = points.triangle[static_cast<std::size_t>(std::countr_zero(points.hits))];
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const auto* floats = static_cast<const float*>((points.hits >> lane & 1u) != 0 ? points.triangle[lane] : any);
    low[lane] = _mm256_load_ps(floats);
    high[lane] = _mm256_load_ps(floats + kLanes);
  }
  transpose(low);
  transpose(high);
  points.position =
      interpolate({low[0], low[1], low[2]}, {low[3], low[4], low[5]}, {low[6], low[7], high[0]}, points.b1, points.b2);
  points.ng = points.ns = {high[1], high[2], high[3]};
  points.extent = high[4];
  unsigned smooth = 0, instanced = 0;
  for_each_lane(points.hits, [&](std::size_t lane) {
    const PlacedTriangles& placed = placed_[points.placement[lane]];
    smooth |= placed.normals != nullptr ? 1u << lane : 0;
    instanced |= placed.instanced ? 1u << lane : 0;
  });
  if (smooth != 0) turn_normals(smooth, points);
  for_each_lane(instanced, [&](std::size_t lane) {
    const SurfacePoint point =
        surface_point(points.placement[lane], points.primitive[lane], points.b1[lane], points.b2[lane]);
    points.position.set(lane, point.position);
    points.ng.set(lane, point.ng);
    points.ns.set(lane, point.ns);
    points.extent[lane] = point.extent;
  });
}

/// Interpolates the corners' normals in `lanes`.
void Scene::turn_normals(unsigned lanes, SurfaceLanes& points) const {
  std::array<Vec3x8, 3> normals{};
  for_each_lane(lanes, [&](std::size_t lane) {
    const auto& corners = placed_[points.placement[lane]].normals[points.primitive[lane]];
    for (std::size_t corner = 0; corner < 3; ++corner) normals[corner].set(lane, corners[corner]);
  });
  const Vec3x8 n = interpolate(normals[0], normals[1], normals[2], points.b1, points.b2);
  const Float8 squared = length2(n);
  const Int8 turned = mask_of(lanes) & (squared > 0.0f);
  points.ns = select(turned, n * ((dot(n, points.ng) < 0.0f ? all(-1.0f) : all(1.0f)) / sqrt(squared)), points.ng);
}

}  // namespace pf
