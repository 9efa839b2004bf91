#pragma once

#include <cmath>

#include "common/math/vec.h"

namespace pf {

/// Right-handed orthonormal basis (t, b, n); local z is n.
struct Frame {
  Vec3f t, b, n;

  /// Any basis around unit vector `normal`, without branches [Duff et al. 2017, "Building an Orthonormal Basis,
  /// Revisited", listing 3].
  [[nodiscard]] static Frame from_normal(const Vec3f& normal) {
    const float sign = std::copysign(1.0f, normal.z);
    const float a = -1.0f / (sign + normal.z);
    const float c = normal.x * normal.y * a;
    return {{1.0f + sign * normal.x * normal.x * a, sign * c, -sign * normal.x},
            {c, sign + normal.y * normal.y * a, -normal.y},
            normal};
  }
  [[nodiscard]] Vec3f to_local(const Vec3f& v) const { return {dot(v, t), dot(v, b), dot(v, n)}; }
  [[nodiscard]] Vec3f to_world(const Vec3f& v) const { return t * v.x + b * v.y + n * v.z; }
};

}  // namespace pf
