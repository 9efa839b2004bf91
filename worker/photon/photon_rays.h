#pragma once

#include <cstdint>
#include <vector>

#include "common/film/statistics.h"
#include "worker/photon/photon_differential.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/splat_kernel.h"
#include "worker/scene/medium_stack.h"
#include "worker/scene/scene.h"

namespace pf {

/// One straight piece of a photon path that has scattered at least once: light that the eye does not sample itself.
struct PhotonSegment {
  Vec3f origin;      ///< on the surface that scattered
  Vec3f direction;   ///< unit
  float length = 0;  ///< to the surface met, or to where it leaves the scene's bounds [m]
  Rgb flux;          ///< at the origin [W]; one path among PhotonOptions::paths
  Flow flow = kIndirect;
  /// Part of all paths that are like this one: the lamp's share, and what roulette left over. With it the
  /// differential's area gives the density of paths: paths * share / area.
  float share = 1;
  PhotonDifferential differential;  ///< at the origin
  MediumStack media;                ///< that the segment runs through
  RayKernel::Plane start, end;
};

/// Photon paths as rays [Herzog et al. 2007] with the density of the whole path: the same paths, number for number, as
/// PhotonTracer's for the same options.
class PhotonRays {
 public:
  /// `differentials`: spreads follow the curvature of mirrors and lenses; else those act as if they were flat.
  PhotonRays(const Scene& scene, const PhotonOptions& options, bool differentials);

  struct Figures {
    std::uint64_t rays = 0;
    Faults faults;
  };
  /// Appends the segments of paths [first, end) of a sub-pass, in order.
  void trace(std::uint64_t sub_pass, std::uint32_t first, std::uint32_t end, std::vector<PhotonSegment>& segments,
             Figures& figures) const;
  [[nodiscard]] const PhotonOptions& options() const { return options_; }

 private:
  struct Walk;
  /// What emission densities need of a lamp that is no surface.
  struct Distant {
    float share = 0;  ///< probability with which emit() picks it
    bool directional = false;
    Vec3f axis{0, 0, 1};  ///< of a point or spot light: that of its sampling
  };

  void find_shares();
  [[nodiscard]] bool emit(std::uint64_t sub_pass, std::uint32_t path, Walk& walk) const;
  void spread_of_emission(const Lights::EmissionPicked& picked, float u_light, const Vec2f& u_position,
                          const Vec2f& u_direction, Walk& walk) const;
  [[nodiscard]] bool scatter(Walk& walk, const SurfacePoint& point) const;
  void spread_of_scattering(Walk& walk, const SurfacePoint& point, const Bsdf& bsdf, const SurfaceParams& params,
                            const BsdfSample& sample) const;
  [[nodiscard]] float exit_distance(const Vec3f& origin, const Vec3f& direction) const;

  const Scene& scene_;
  PhotonOptions options_;
  bool differentials_;
  std::vector<Distant> distant_;  ///< punctual lights in order, then the environment
  float scene_radius_ = 0;
};

/// How the shading normal of a smooth mesh changes around a point, by looking at the surface a little further along
/// both tangents. Flat where the mesh ends or has no normals of its own.
[[nodiscard]] SurfaceShape shape_around(const Scene& scene, const SurfacePoint& point);

/// How wide kernels are.
struct KernelRule {
  float photons = 32;   ///< that one kernel holds where all paths are like its own
  float widest = 0;     ///< bound of its radius [m]
  bool ellipse = true;  ///< false: a circle of the same mean squared axes
  float smoothing = 1;  ///< multiplies the width, but not `widest`
};
/// The kernel of a segment of `paths` paths: area photons / (paths * density of the path) across the ray, wider with
/// each bounce and with the length of each segment.
[[nodiscard]] RayKernel kernel_of(const PhotonSegment& segment, std::uint32_t paths, const KernelRule& rule);

}  // namespace pf
