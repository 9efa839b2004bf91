#pragma once

#include <algorithm>
#include <cmath>

#include "common/math/vec.h"

namespace pf {

/// Largest absolute coordinate of `p`.
[[nodiscard]] inline float max_magnitude(const Vec3f& p) {
  return std::max(std::abs(p.x), std::max(std::abs(p.y), std::abs(p.z)));
}

/// Distance by which offset_ray_origin moves, relative to the magnitude of the coordinates: 256 units in the
/// last place of a float in [1, 2), halved [Wächter and Binder 2019, "A Fast and Robust Method for Avoiding
/// Self-Intersection", Ray Tracing Gems chapter 6: float scale 1/65536].
inline constexpr float kRayOffset = 0x1p-16f;

/// Origin of a ray that leaves the surface point `p`, whose unit geometric normal is `ng`, in `direction`:
/// moved off the surface to the side that `direction` points to, so that the ray does not meet its own
/// triangle again.
///
/// The error of an interpolated hit point is a few units in the last place of the triangle's corners, which
/// can be much larger than that of `p` itself (the middle of a floor around the world's origin). So `extent`
/// is the largest absolute coordinate of the corners; the default of 1 is the guard that the paper uses. The
/// paper adds 256 ulp to each coordinate by itself; moving all three by the same bound keeps the move along
/// the normal and covers coordinates that are small beside the others. Moved distance: kRayOffset *
/// max(extent, |p|_max).
[[nodiscard]] inline Vec3f offset_ray_origin(const Vec3f& p, const Vec3f& ng, const Vec3f& direction,
                                             float extent = 1.0f) {
  const float distance = kRayOffset * std::max(extent, max_magnitude(p));
  return p + ng * std::copysign(distance, dot(direction, ng));
}

}  // namespace pf
