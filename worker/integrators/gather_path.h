#pragma once

#include "worker/integrators/gather_rays.h"

namespace pf {

/// What a gather ray brings, by path tracing: no photon map, no bias.
///
/// Kajiya 1986, "The Rendering Equation". A path goes on from what the ray meets; at every vertex one light
/// sample with multiple importance sampling against the BSDF, as in PathIntegrator. Until the path has
/// scattered by a gather portion, only what gather portions scatter counts: the rest is direct light or
/// caustics, which others add. Where it fails: light that caustics cast on what the ray meets is found by
/// chance only, that of point and directional lights never.
class PathGather final : public GatherRadiance {
 public:
  /// `max_depth`: bounces of a whole eye path, of which the first is the gather point's; 0: no bound but
  /// Russian roulette.
  PathGather(const Scene& scene, int max_depth) : scene_(scene), max_depth_(max_depth) {}
  [[nodiscard]] Arrival arriving(const Ray& ray, const MediumStack& media, PathRng& rng,
                                 TileFigures& figures) const override;

 private:
  struct Walk;
  /// Adds direct light at the vertex and scatters; false when the path ends.
  bool scatter(Walk& walk, const Vertex& vertex, PathRng& rng, TileFigures& figures) const;

  const Scene& scene_;
  int max_depth_;
};

}  // namespace pf
