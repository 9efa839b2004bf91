#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "worker/scene/embree.h"
#include "worker/scene/scene.h"

namespace pf {

/// Embree behind Scene: one top-level scene whose geometry ids are placement indices.
struct Scene::Embree {
  struct DeviceRelease {
    void operator()(RTCDevice d) const { rtcReleaseDevice(d); }
  };
  struct SceneRelease {
    void operator()(RTCScene s) const { rtcReleaseScene(s); }
  };
  using DevicePtr = std::unique_ptr<RTCDeviceTy, DeviceRelease>;
  using ScenePtr = std::unique_ptr<RTCSceneTy, SceneRelease>;

  DevicePtr device;
  std::vector<ScenePtr> mesh_scenes;  ///< of meshes placed more than once
  ScenePtr top;

  [[nodiscard]] std::optional<Hit> intersect(const Vec3f& origin, const Vec3f& direction, float t_max) const {
    RTCRayHit ray_hit;
    ray_hit.ray = {origin.x, origin.y, origin.z, 0.0f, direction.x, direction.y, direction.z, 0.0f, t_max, ~0u, 0, 0};
    ray_hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    ray_hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    embree_intersect(top.get(), ray_hit);
    if (ray_hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
    const bool instanced = ray_hit.hit.instID[0] != RTC_INVALID_GEOMETRY_ID;
    return Hit{ray_hit.ray.tfar, ray_hit.hit.u, ray_hit.hit.v, instanced ? ray_hit.hit.instID[0] : ray_hit.hit.geomID,
               ray_hit.hit.primID};
  }
  static constexpr std::size_t kPacket = 8;
  /// At most kPacket rays at once; hit.geomID[i] is RTC_INVALID_GEOMETRY_ID where ray i meets nothing.
  [[nodiscard]] RTCRayHit8 intersect(std::span<const Ray> rays) const {
    RTCRayHit8 packet;
    alignas(32) int valid[kPacket];
    for (std::size_t i = 0; i < kPacket; ++i) {
      valid[i] = i < rays.size() ? -1 : 0;
      packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
      packet.ray.tnear[i] = 0.0f;
      packet.ray.time[i] = 0.0f;
      packet.ray.mask[i] = ~0u;
      packet.ray.id[i] = 0;
      packet.ray.flags[i] = 0;
    }
    for (std::size_t i = 0; i < rays.size(); ++i) {
      packet.ray.org_x[i] = rays[i].origin.x;
      packet.ray.org_y[i] = rays[i].origin.y;
      packet.ray.org_z[i] = rays[i].origin.z;
      packet.ray.dir_x[i] = rays[i].direction.x;
      packet.ray.dir_y[i] = rays[i].direction.y;
      packet.ray.dir_z[i] = rays[i].direction.z;
      packet.ray.tfar[i] = rays[i].t_max;
    }
    embree_intersect(valid, top.get(), packet);
    return packet;
  }
  [[nodiscard]] static std::uint32_t placement_of(const RTCHit8& hit, std::size_t i) {
    return hit.instID[0][i] == RTC_INVALID_GEOMETRY_ID ? hit.geomID[i] : hit.instID[0][i];
  }
  [[nodiscard]] bool occluded(const Vec3f& origin, const Vec3f& direction, float t_max) const;

  /// Runs in Embree for geometries whose material is a mask or a blend; drops hits that alpha lets through.
  static void alpha_filter(const RTCFilterFunctionNArguments* args);
};

}  // namespace pf
