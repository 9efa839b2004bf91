#pragma once

#include <cstdint>
#include <span>

#include "common/math/vec.h"
#include "worker/photon/photon_tree.h"
#include "worker/scene/scene.h"

namespace pf {

/// Of a disc; whole packets of kLanes.
inline constexpr int kProbes = 16;

/// Part of a gather disc, in (0, 1], on which photons could have been found: the rest hangs over an edge,
/// lies behind a wall or under an object. Dividing the flux by it removes the darkening at edges that a full
/// disc's area causes
/// ("boundary bias"; [Jensen 2001, 7.2.2] divides by the convex hull of the photons instead, which needs many
/// of them).
///
/// Measured with kProbes probes at points spread over the disc (Vogel's spiral, turned and shifted by `u`),
/// each a ray from above the hit point to above the probe, then one straight down: it counts when it meets a
/// surface on which the query would accept a photon. Unbiased for the area; its inverse is biased by less
/// than 1 % at a straight edge (tests/unit/photon).
struct Coverage {
  float fraction = 1;             ///< in (0, 1]
  float nearest_gap = kInfinity;  ///< distance from the hit point to the nearest probe that did not count [m]
};
/// `probes`: kProbes or twice as many.
[[nodiscard]] Coverage measure_coverage(const Scene& scene, const SurfacePoint& point, const DiscQuery& query,
                                        const Vec2f& u, std::uint64_t& rays, int probes = kProbes);

/// A disc around a point that an eye path has met.
struct GatherDisc {
  SurfacePoint point;
  DiscQuery query;
  Vec2f u;                   ///< turns and shifts the probes
  float covered_radius = 0;  ///< result [m]: discs around this point up to this radius lie whole on the surface
};
/// Finds the covered radius of every disc; infinite where no gap was found. Discs side by side on one surface
/// are judged by a single wider one around them all, and each by itself only where that one meets a gap.
void find_covered_radii(const Scene& scene, std::span<GatherDisc> discs, std::uint64_t& rays);

}  // namespace pf
