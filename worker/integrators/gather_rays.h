#pragma once

#include "common/math/philox.h"
#include "worker/integrators/eye.h"
#include "worker/scene/medium_stack.h"
#include "worker/scene/scene.h"

namespace pf {

/// What a gather ray brings: the indirect light, without caustics, that arrives at its origin. That is light which a surface
/// scattered by its gather portion before: light straight from a lamp is sampled at the gather point itself, and light that
/// sharp reflections or refractions alone brought from a lamp belongs to the caustic map.
///
/// A ray goes on where a surface follows (Portion::kFollow) and ends where one gathers; what it meets of lamps and of the
/// environment on its way never counts.
class GatherRadiance {
 public:
  virtual ~GatherRadiance() = default;

  struct Arrival {
    Rgb radiance{0, 0, 0};       ///< W sr^-1 m^-2, finite
    float distance = kInfinity;  ///< metres to the first surface met; kInfinity where the ray leaves the scene
  };
  /// `ray` starts off its surface, inside of `media`. Rays shot and contributions that are not finite are counted in `figures`.
  /// Depends on its arguments alone; called by many threads at once.
  [[nodiscard]] virtual Arrival arriving(const Ray& ray, const MediumStack& media, PathRng& rng, TileFigures& figures) const = 0;
};

}  // namespace pf
