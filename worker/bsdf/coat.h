#pragma once

#include "common/math/frame.h"
#include "common/math/vec.h"

namespace pf {

/// KHR_materials_clearcoat: a colourless dielectric layer of F0 = 0.04 with its own normal. Plain data,
/// written by Bsdf.
struct Coat {
  static constexpr float kF0 = 0.04f;

  float weight;            ///< clearcoat factor; 0: no coat
  float alpha, roughness;  ///< alpha = 0: mirror
  Frame frame;             ///< z on wo's side
  Vec3f wo;                ///< local to `frame`

  /// Directional albedo from a direction at `cosine` to the coat's normal; what lies below keeps 1 - albedo
  /// at most.
  [[nodiscard]] float albedo(float cosine) const;
  /// Reflectance at a facet under angle `cosine`.
  [[nodiscard]] float reflectance(float cosine) const;
};

}  // namespace pf
