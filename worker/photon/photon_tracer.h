#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "common/film/statistics.h"
#include "common/math/lanes.h"
#include "worker/photon/emission_guide.h"
#include "worker/photon/photon.h"
#include "worker/scene/scene.h"

namespace pf {

class ProjectionMap;
struct JobSpec;
class PhotonPool;
struct PhotonLanes;
struct PhotonNumbers;

struct PhotonOptions {
  std::uint64_t seed = 1;
  std::uint32_t paths = 500000;  ///< per sub-pass
  int max_depth = 32;            ///< surface hits of a path; 0: no bound but Russian roulette
  bool direct = false;           ///< also keep the first hits, apart from the flows: for maps that hold all light
  bool caustics_only = false;    ///< a path ends where it scatters other than sharply, and only kCaustic is kept
  const ProjectionMap* projection = nullptr;  ///< emit only towards surfaces that matter; outlives the tracer
  const EmissionGuide* guide = nullptr;       ///< emit where it matters, without `projection`; outlives the tracer
  bool number_photons = false;                ///< Photon::direction holds the number of the photon's path instead
};

/// What a job asks for: its seed, photons and depth.
[[nodiscard]] PhotonOptions photon_options(const JobSpec& spec);

/// Photons of one sub-pass, by flow, and what tracing them took.
struct PhotonBatch {
  std::array<Photons, kFlows> flows;
  Photons direct;  ///< straight from a lamp; empty without PhotonOptions::direct
  std::uint64_t rays = 0;
  std::uint64_t lost = 0;  ///< paths whose first ray met nothing
  Faults faults;
};

/// Emits and follows the photon paths of sub-passes [Jensen 1996; Jensen 2001, chapter 5]: flux Phi/N by
/// light, Russian roulette that keeps photons whole, storage at every non-specular hit after the first
/// (direct light is sampled from the eye), and at the first, too, when the options ask for it. A photon's flux is kept
/// in units of flux_unit(), folded with |cos(ns)|/|cos(ng)| at its hit, so that a gather over a Lambert surface is a
/// plain sum [Veach 1997, 5.3].
class PhotonTracer {
 public:
  PhotonTracer(const Scene& scene, const PhotonOptions& options);

  /// All paths of one sub-pass; the same photons in the same order on any number of threads.
  [[nodiscard]] PhotonBatch trace(std::uint64_t sub_pass) const;
  /// Flux of the mean emitted path of a sub-pass [W]: mean over channels of the emitted flux / paths.
  [[nodiscard]] double flux_unit() const { return flux_unit_; }
  [[nodiscard]] const PhotonOptions& options() const { return options_; }

  /// The numbers with which a path starts, and their weight.
  [[nodiscard]] EmissionGuide::Drawn emission(std::uint64_t sub_pass, std::uint32_t path) const;

  /// Every ray of one sub-pass in the order in which one thread shoots them: what the bench replays.
  [[nodiscard]] std::vector<Ray> rays_of(std::uint64_t sub_pass) const;

 private:
  struct Walk;
  struct Part;
  struct Arrivals;
  /// Albedo of a plain Lambert reflector and 1, or zeros.
  struct alignas(16) Matte {
    float red = 0, green = 0, blue = 0, plain = 0;
  };
  /// Paths [first, end), appended to `part`; `watch` is called with all rays about to be shot.
  template <typename Watch>
  void trace_paths(std::uint64_t sub_pass, std::uint32_t first, std::uint32_t end, Part& part, Watch&& watch) const;
  /// Emits paths [first, first + 8) as far as `end`; those that carry something join `pool`.
  void start(const PhotonNumbers& numbers, std::uint32_t first, std::uint32_t end, PhotonPool& pool) const;
  void emit(const PhotonNumbers& numbers, std::uint32_t first, EmissionLanes& emissions) const;
  void emit_guided(std::array<Float8, 4> u, Float8 last, EmissionLanes& emissions) const;
  [[nodiscard]] bool guided() const { return options_.guide != nullptr && !options_.guide->uniform(); }
  /// Stores the photons at the points that they met; those that go on join `pool`.
  void scatter(const PhotonNumbers& numbers, const SurfaceLanes& points, PhotonLanes& photons, PhotonPool& pool,
               Part& part) const;
  [[nodiscard]] std::pair<Vec3x8, unsigned> matte(const SurfaceLanes& points) const;
  bool scatter_any(Walk& walk, const SurfacePoint& point, std::size_t lane, Arrivals& arrivals) const;
  /// Returns the lanes that lie on such surfaces, and adds to `on` those that go on.
  unsigned scatter_smooth(unsigned lanes, const SurfaceLanes& points, const std::array<Float8, 4>& u,
                          PhotonLanes& photons, unsigned& on) const;
  unsigned scatter_lambert(unsigned lanes, const Vec3x8& albedo, const SurfaceLanes& points,
                           const std::array<Float8, 4>& u, PhotonLanes& photons, Arrivals& arrivals) const;
  [[nodiscard]] static unsigned follow(const Int8& mask, const Vec3x8& wi, const Vec3x8& weight, const Float8& u,
                                       const SurfaceLanes& points, PhotonLanes& photons);
  void store(const Arrivals& arrivals, Part& part) const;

  const Scene& scene_;
  PhotonOptions options_;
  double flux_unit_ = 0;
  std::vector<Matte> matte_;  ///< per material
  float emitted_scale_ = 0;   ///< from the flux of all paths [W] to flux_unit()
  bool lamps_alike_ = false;  ///< every path starts in air, with the emission of its lamp's mean
};

}  // namespace pf
