#pragma once

#include "common/math/lanes.h"
#include "worker/scene/scene.h"

namespace pf {

/// Eight rays.
struct RayLanes {
  Vec3x8 origin, direction;
  Float8 t_max = all(kInfinity);
  bool alike = false;  ///< near each other and in like directions: they go through the scene together
};

/// What eight rays met: SurfacePoint, side by side. Lanes that met nothing hold anything.
struct SurfaceLanes {
  unsigned hits = 0;  ///< bit i: lane i met a surface
  Vec3x8 position, ng, ns;
  Float8 t, b1, b2, extent;
  alignas(32) std::array<std::uint32_t, kLanes> placement, primitive;
  alignas(32) std::array<int, kLanes> material;
  std::array<const void*, kLanes> triangle;  ///< where its corners lie

  [[nodiscard]] SurfacePoint point(std::size_t lane) const {
    return {.position = position[lane],
            .ng = ng[lane],
            .ns = ns[lane],
            .t = t[lane],
            .placement = placement[lane],
            .primitive = primitive[lane],
            .b1 = b1[lane],
            .b2 = b2[lane],
            .extent = extent[lane],
            .material = material[lane]};
  }
};

}  // namespace pf
