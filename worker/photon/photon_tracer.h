#pragma once

#include <array>
#include <cstdint>

#include "common/film/statistics.h"
#include "worker/photon/photon.h"
#include "worker/scene/scene.h"

namespace pf {

struct PhotonOptions {
  std::uint64_t seed = 1;
  std::uint32_t paths = 500000;   ///< per sub-pass
  int max_depth = 32;             ///< surface hits of a path; 0: no bound but Russian roulette
};

/// Photons of one sub-pass, by flow, and what tracing them took.
struct PhotonBatch {
  std::array<PhotonArrays, kFlows> flows;
  std::uint64_t rays = 0;
  Faults faults;
};

/// Emits and follows the photon paths of sub-passes [Jensen 1996; Jensen 2001, chapter 5]: flux Phi/N by light, Russian
/// roulette that keeps photons whole, storage at every non-specular hit after the first: direct light is sampled from the
/// eye. A photon's flux is kept in units of flux_unit(), folded with |cos(ns)|/|cos(ng)| at its hit, so that a gather over
/// a Lambert surface is a plain sum [Veach 1997, 5.3].
class PhotonTracer {
 public:
  PhotonTracer(const Scene& scene, const PhotonOptions& options);

  /// All paths of one sub-pass; the same photons in the same order on any number of threads.
  [[nodiscard]] PhotonBatch trace(std::uint64_t sub_pass) const;
  /// Flux of the mean emitted path of a sub-pass [W]: mean over channels of the emitted flux / paths.
  [[nodiscard]] double flux_unit() const { return flux_unit_; }
  [[nodiscard]] const PhotonOptions& options() const { return options_; }

  /// One path, appended to `batch`; public for the bench.
  void trace_path(std::uint64_t sub_pass, std::uint32_t path, PhotonBatch& batch) const;

 private:
  struct Walk;
  void store(const Walk& walk, const SurfacePoint& point, const Vec3f& wo, const Vec3f& ng, const Vec3f& ns,
             PhotonBatch& batch) const;

  const Scene& scene_;
  PhotonOptions options_;
  double flux_unit_ = 0;
};

}  // namespace pf
