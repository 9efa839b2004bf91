#include "worker/integrators/first_radius.h"

#include <algorithm>
#include <cmath>

namespace pf {

double wanted_photons(const RadiusRule& rule, double paths) {
  return double{rule.photons} * std::pow(paths / kRulePaths, 2.0 / 3.0);
}

float FirstRadius::squared(GatherCursor& photons, Flow flow, DiscQuery query, float footprint) const {
  if (fixed > 0.0) return static_cast<float>(fixed * fixed);
  const RadiusRule& rule = kRadiusRules[flow];
  // No disc is wider than a part of the scene, however far away the surface is seen from.
  constexpr float kMaxSceneShare = 0.05f;  // 0.08 brightens the corners of the peer box visibly
  const float largest = std::min(rule.max_footprints * footprint, kMaxSceneShare * scene_radius);
  const float smallest = std::min(rule.min_footprints * footprint, largest);
  query.radius2 = largest * largest;
  auto found = static_cast<float>(photons.count(query));
  const auto wanted = static_cast<float>(wanted_photons(rule, paths));
  // On a surface the number found goes with the area.
  for (int refinement = 0; refinement < 3 && found > wanted && query.radius2 > smallest * smallest; ++refinement) {
    query.radius2 = std::max(query.radius2 * wanted / found, smallest * smallest);
    found = static_cast<float>(photons.count(query));
  }
  return query.radius2;
}

}  // namespace pf
