#pragma once

#include <cstdint>
#include <memory>

#include "common/spec/job_spec.h"
#include "worker/integrators/direct_light.h"
#include "worker/integrators/eye.h"
#include "worker/photon/photon_map.h"
#include "worker/photon/photon_map_filter.h"
#include "worker/photon/photon_tracer.h"
#include "worker/scene/scene.h"

namespace pf {

/// Photons of a job, traced for one purpose, and what tracing them took.
struct TracedPhotons {
  /// What the photons are for; each has random numbers of its own.
  enum class Purpose {
    kGlobal,   ///< integrator.photons paths; first hits are kept apart
    kCaustics  ///< photon_map.caustic_photons paths, emitted only where they may meet something specular
  };
  /// `max_depth`: surface hits of a path; 0: no bound but Russian roulette.
  TracedPhotons(const Scene& scene, const JobSpec& spec, Purpose purpose, int max_depth);

  [[nodiscard]] TileFigures figures() const;

  PhotonBatch batch;
  std::uint64_t paths = 0;
  double flux_unit = 0;  ///< W: what the photons' flux counts in
};

/// A photon map and how to estimate from it [Jensen 1996, 4.3; Jensen 2001, 7.1]: the k nearest photons on a
/// surface, those only which lie on it, within a maximum distance, weighed by a filter.
///
/// Biased: illumination is blurred over the disc. Discs that hang over an edge are divided by the part that
/// lies on the surface (measure_coverage), which the disc filter does exactly and the others nearly.
class MapEstimate {
 public:
  struct Options {
    std::uint32_t nearest = 100;
    double max_distance = 0.0;  ///< m; 0: kReach times the median distance of the k-th neighbour of photons,
                                ///< but no more than kLargestShare of the scene's radius
    PhotonFilter filter = PhotonFilter::kCone;
  };
  MapEstimate() = default;
  MapEstimate(const Scene& scene, std::span<const Photons* const> flows, double flux_unit, const Options& options);

  /// Radiance [W sr^-1 m^-2] that `portion` of the BSDF scatters towards vertex.wo, of the light that the map
  /// holds. `covered`: radius up to which discs around the vertex are known to lie on the surface whole [m];
  /// `u` turns the probes otherwise.
  [[nodiscard]] Rgb radiance(const Scene& scene, const Vertex& vertex, Portion portion, float covered, const Vec2f& u,
                             TileFigures& figures) const;
  /// Irradiance [W m^-2] at a point, without regard to edges, and the radius of the disc [m].
  struct Irradiance {
    Rgb irradiance{0, 0, 0};
    float radius = 0;
  };
  [[nodiscard]] Irradiance irradiance(const Vec3f& position, const Vec3f& normal) const;

  [[nodiscard]] const PhotonMap& photons() const { return map_; }
  [[nodiscard]] float max_distance() const { return max_distance_; }
  [[nodiscard]] std::uint32_t nearest() const { return options_.nearest; }
  [[nodiscard]] double flux_unit() const { return flux_unit_; }
  [[nodiscard]] bool empty() const { return map_.empty(); }

 private:
  static constexpr float kReach = 3.0f;
  static constexpr float kLargestShare = 0.1f;

  [[nodiscard]] float choose_max_distance(const Scene& scene) const;
  [[nodiscard]] const NearestPhotons& find(const Vec3f& position, const Vec3f& normal, bool both_sides) const;

  PhotonMap map_;
  Options options_;
  MapFilter filter_{PhotonFilter::kCone};
  float max_distance_ = 0;
  double flux_unit_ = 0;
};

/// How to estimate from the global and from the caustic map of a job.
[[nodiscard]] MapEstimate::Options global_options(const JobSpec& spec);
[[nodiscard]] MapEstimate::Options caustic_options(const JobSpec& spec);

/// The disc that an estimate at the vertex searches.
[[nodiscard]] inline DiscQuery disc_at(const Vertex& vertex, float radius) {
  return {vertex.point.position, vertex.bsdf.ng(), radius * radius,
          vertex.transmissive && !vertex.bsdf.gather_is_lambert()};
}

}  // namespace pf
