#include "worker/integrators/first_radius.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace pf {

double wanted_photons(const RadiusRule& rule, double paths) {
  return double{rule.photons} * std::pow(paths / kRulePaths, 2.0 / 3.0);
}

RadiusBounds radius_bounds(const RadiusRule& rule, float footprint, float scene_radius) {
  // No disc is wider than a part of the scene, however far away the surface is seen from.
  constexpr float kMaxSceneShare = 0.05f;  // 0.08 brightens the corners of the peer box visibly
  const float largest = std::min(rule.max_footprints * footprint, kMaxSceneShare * scene_radius);
  return {std::min(rule.min_footprints * footprint, largest), largest};
}

float FirstRadius::squared(GatherCursor& photons, Flow flow, DiscQuery query, float footprint) const {
  if (fixed > 0.0) return static_cast<float>(fixed * fixed);
  const RadiusRule& rule = kRadiusRules[flow];
  const auto [smallest, largest] = radius_bounds(rule, footprint, scene_radius);
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

float FirstRadius::widened(GatherCursor& photons, DiscQuery query, float radius2) const {
  if (fixed > 0.0) return radius2;
  constexpr float kSignificance = 2.5f;  // standard deviations; 1.5 keeps more discs narrow and gains less
  query.radius2 = kWidening * radius2;
  thread_local std::vector<std::uint32_t> found;
  found.clear();
  photons.collect(query, found);
  float bias = 0.0f, variance = 0.0f;
  for (const std::uint32_t i : found) {
    const Vec3f offset = photons.tree().position(i) - query.position;
    const float part = luminance(photons.tree().flux(i)) * bias_weight(dot(offset, offset), query.radius2);
    bias += part;
    variance += part * part;
  }
  return std::abs(bias) <= kSignificance * std::sqrt(variance) ? query.radius2 : radius2;
}

}  // namespace pf
