#pragma once

#include <cstdint>

#include "common/math/vec.h"

namespace pf {

/// One emissive triangle in world space. `radiance` is Le averaged over its texture (for choosing); the exact
/// Le at a point is asked from the scene.
struct EmissiveTriangle {
  Vec3f p0, p1, p2;
  Vec3f ng;  ///< unit, front side
  Rgb radiance;
  bool two_sided = false;
  std::uint32_t geometry = 0;  ///< ids that Scene uses to look the emitter up again
  std::uint32_t primitive = 0;
};

}  // namespace pf
