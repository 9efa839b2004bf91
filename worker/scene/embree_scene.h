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
  struct Hit {
    float t, b1, b2;
    std::uint32_t placement, primitive;
  };
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

  [[nodiscard]] std::optional<Hit> intersect(const Vec3f& origin, const Vec3f& direction, float t_max) const;
  [[nodiscard]] bool occluded(const Vec3f& origin, const Vec3f& direction, float t_max) const;

  /// Runs in Embree for geometries whose material is a mask or a blend; drops hits that alpha lets through.
  static void alpha_filter(const RTCFilterFunctionNArguments* args);
};

}  // namespace pf
