#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "worker/scene/embree.h"
#include "worker/scene/scene.h"
#include "worker/scene/surface_lanes.h"

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
  /// The rays of `lanes` at once: t, b1, b2, placement and primitive of `met`, and which lanes met a surface.
  void intersect(const RayLanes& rays, unsigned lanes, SurfaceLanes& met) const;
  [[nodiscard]] bool occluded(const Vec3f& origin, const Vec3f& direction, float t_max) const;

  /// Runs in Embree for geometries whose material is a mask or a blend; drops hits that alpha lets through.
  static void alpha_filter(const RTCFilterFunctionNArguments* args);
};

}  // namespace pf
