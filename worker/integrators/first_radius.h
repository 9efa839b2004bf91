#pragma once

#include <array>

#include "common/film/statistics.h"
#include "worker/photon/photon_tree.h"

namespace pf {

/// Photons of the first sub-pass that the first disc shall hold, and bounds of its radius in pixel footprints: wide
/// where light is smooth, narrow for caustics. Chosen on the peer box: 600 to 800 photons lower its noise by 5 % and
/// brighten corners.
struct RadiusRule {
  float photons;  ///< of a sub-pass of kRulePaths paths; others: wanted_photons()
  float min_footprints;
  float max_footprints;
};
inline constexpr std::array<RadiusRule, kFlows> kRadiusRules{RadiusRule{12.0f, 0.75f, 3.0f},
                                                             RadiusRule{400.0f, 1.0f, 16.0f}};
inline constexpr double kRulePaths = 500000.0;

/// p^(2/3) times as many photons for p times as many paths, so that the radius after a given total of paths, which
/// shrinks with the cube root of the sub-passes, does not depend on how they are cut.
[[nodiscard]] double wanted_photons(const RadiusRule& rule, double paths);

/// Radii that a first disc may have [m], where a pixel's footprint is so wide [m] in a scene with this radius [m].
struct RadiusBounds {
  float smallest;
  float largest;
};
[[nodiscard]] RadiusBounds radius_bounds(const RadiusRule& rule, float footprint, float scene_radius);

/// Area of a disc where light changes evenly, over that of the rule. Four times brings no more
/// (tests/bench/FINDINGS.md).
inline constexpr float kWidening = 2.0f;

/// Weight of a photon at this squared distance [m^2] from the middle of a disc in the sum that tells what the disc adds
/// to its middle's light: 0 in the mean where light changes evenly (from the second moment, as [Hachisuka, Jarosz,
/// Jensen 2010] take the Laplacian from derivatives of a kernel).
[[nodiscard]] inline float bias_weight(float distance2, float radius2) { return 6.0f * distance2 / radius2 - 3.0f; }

/// Chooses the discs that progressive photon mapping starts with.
struct FirstRadius {
  double fixed = 0;        ///< [m]; 0: by the rules
  float scene_radius = 0;  ///< half the diagonal of the scene's bounds [m]
  double paths = 0;        ///< that `photons` below come from

  /// Squared radius [m^2] at a place whose pixel's footprint is so wide [m]; `query.radius2` does not matter.
  [[nodiscard]] float squared(GatherCursor& photons, Flow flow, DiscQuery query, float footprint) const;
  /// kWidening times `radius2` where the photons do not deny that light changes evenly over such a disc, else
  /// `radius2`: adaptive bandwidth [Kaplanyan and Dachsbacher 2013], decided once. Whether the surface reaches so far
  /// is for the caller to see.
  [[nodiscard]] float widened(GatherCursor& photons, DiscQuery query, float radius2) const;
};

}  // namespace pf
