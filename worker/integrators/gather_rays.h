#pragma once

#include "common/math/philox.h"
#include "common/spec/job_spec.h"
#include "worker/integrators/eye.h"
#include "worker/integrators/map_estimate.h"
#include "worker/scene/medium_stack.h"
#include "worker/scene/scene.h"

namespace pf {

/// What a gather ray brings: the indirect light, without caustics, that arrives at its origin. That is light
/// which a surface scattered by its gather portion before: light straight from a lamp is sampled at the
/// gather point itself, and light that sharp reflections or refractions alone brought from a lamp belongs to
/// the caustic map.
///
/// A ray goes on where a surface follows (Portion::kFollow) and ends where one gathers; what it meets of
/// lamps and of the environment on its way never counts.
class GatherRadiance {
 public:
  virtual ~GatherRadiance() = default;

  struct Arrival {
    Rgb radiance{0, 0, 0};       ///< W sr^-1 m^-2, finite
    float distance = kInfinity;  ///< metres to the first surface met; kInfinity where the ray leaves the scene
  };
  /// `ray` starts off its surface, inside of `media`. Rays shot and contributions that are not finite are
  /// counted in `figures`. Depends on its arguments alone; called by many threads at once.
  [[nodiscard]] virtual Arrival arriving(const Ray& ray, const MediumStack& media, PathRng& rng,
                                         TileFigures& figures) const = 0;
};

/// What a gather ray brings, from a global photon map that holds all light: direct, caustic and indirect
/// [Jensen 1996, 4.2].
///
/// With final_gather.precompute, irradiance is estimated beforehand at every fourth photon, and a ray takes
/// that of the nearest one whose surface faces the same way [Christensen 1999, "Faster Photon Map Global
/// Illumination"]; else each ray estimates its own. Surfaces that gather other than by a Lambert reflector
/// always estimate. Biased by the map: what arrives is blurred over the estimates' discs.
class MapGather final : public GatherRadiance {
 public:
  MapGather(const Scene& scene, const JobSpec& spec);
  [[nodiscard]] Arrival arriving(const Ray& ray, const MediumStack& media, PathRng& rng,
                                 TileFigures& figures) const override;

  /// The indirect photons alone: where the light comes from that gather rays look for.
  [[nodiscard]] const PhotonMap& indirect_photons() const { return indirect_; }
  [[nodiscard]] const MapEstimate& map() const { return map_; }
  /// Irradiance of the surface point nearest to here for which it was precomputed [W m^-2].
  [[nodiscard]] Rgb precomputed(const Vec3f& position, const Vec3f& normal) const;
  /// What tracing and precomputing took.
  [[nodiscard]] const TileFigures& figures() const { return figures_; }

 private:
  void precompute(const JobSpec& spec);
  [[nodiscard]] Rgb leaving(const Vertex& vertex, PathRng& rng, TileFigures& figures) const;

  const Scene& scene_;
  int max_depth_;
  MapEstimate map_;
  PhotonMap indirect_;
  PhotonMap irradiance_;  ///< photons whose "flux" is the irradiance [W m^-2]; empty: not precomputed
  bool precomputed_ = false;
  TileFigures figures_;
};

}  // namespace pf
