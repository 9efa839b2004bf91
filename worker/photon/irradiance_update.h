#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "worker/photon/irradiance_cache.h"
#include "worker/photon/irradiance_parts.h"
#include "worker/photon/irradiance_reach.h"
#include "worker/scene/scene.h"

namespace pf {

/// Light that a change of a scene can have brought or taken, where it left surfaces: upper bounds from
/// photons whose path the change can have altered, of any number of bounces, on a grid of cubes over the
/// scene.
///
/// Photons of the new scene count from where their path first crosses a box of the change, or from their lamp
/// when that is new, and twice from there: as they go on in the new scene, and as they would in the old one,
/// where the box was empty (straight through) or held something else (scattered any way). Lamps that are gone
/// send photons as well. So light that left a place and light that came there add up; they never cancel.
class ChangedLight {
 public:
  ChangedLight(const Scene& scene, const SceneChange& change, int max_depth, std::uint64_t seed);

  /// Radiance that can have come or gone on surfaces around `point`.
  [[nodiscard]] float radiance(const Vec3f& point) const;
  [[nodiscard]] std::uint64_t rays() const { return rays_; }

 private:
  struct Photon;
  class Walk;
  [[nodiscard]] std::size_t cell(const Vec3f& point) const;
  void trace_lamps(int max_depth, std::uint64_t seed);
  void trace_gone(const ScenePart& lamp, std::uint64_t index, int max_depth, std::uint64_t seed);

  const Scene& scene_;
  const SceneChange& change_;
  Box3f bounds_;
  float edge_ = 0;                                 ///< of a cube [m]
  float unit_ = 0;                                 ///< flux of one step of `steps_` [W]
  std::vector<std::atomic<std::uint64_t>> steps_;  ///< integers: sums have no order
  std::atomic<std::uint64_t> rays_{0};
};

/// A record is computed again when its irradiance may have changed by more than this part. What lies below
/// stays: a bound on the error of what an update keeps.
inline constexpr float kTouchedPart = 0.02f;

/// Upper bound on the part by which a change can have altered a record's irradiance. Its own gather rays that
/// cross the change count with all that they brought, and with a multiple of the mean of all rays for what
/// they may bring now; the others with the changed light where they ended.
///
/// Bounds are estimates where light bounces: by photons, as dense as a fixed number of them lies.
[[nodiscard]] float changed_part(const IrradianceRecord& record, const RecordReach& reach, std::uint64_t seed,
                                 const SceneChange& change, const ChangedLight& light);

}  // namespace pf
