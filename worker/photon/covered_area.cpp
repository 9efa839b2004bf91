#include "worker/photon/covered_area.h"

#include <algorithm>
#include <cmath>

#include "common/math/frame.h"

namespace pf {
namespace {

/// A lamp or a mirror flush with the surface leaves a hole in the disc: no photon is ever stored there.
bool stores_photons(const Scene& scene, const SurfacePoint& point, const Vec3f& wo) {
  const Bsdf bsdf(scene.evaluate(point, 1.0f), wo);
  return !bsdf.is_black() && !bsdf.is_delta_only();
}

}  // namespace

Coverage measure_coverage(const Scene& scene, const SurfacePoint& point, const DiscQuery& query, const Vec2f& u,
                          std::uint64_t& rays) {
  const float radius = std::sqrt(query.radius2);
  const Frame frame = Frame::from_normal(query.normal);
  const Vec3f start = offset_past(point, query.normal);

  // Probes start this part of the radius above the surface: high enough to see the disc over slightly curved ground,
  // low enough to be stopped by what stands on it; lower where something lies close above.
  constexpr float kHeight = 0.35f;
  float height = kHeight * radius;
  ++rays;
  if (const auto above = scene.intersect({start, query.normal, height})) height = 0.5f * above->t;
  const Vec3f eye = start + query.normal * height;

  // Each probe goes to a point a little above the disc, where walls may stop it, and from there straight down: a slanted one
  // alone would pass over ground that falls away, as on a ball of a few disc radii.
  const float lift = std::min(kPlaneTolerance * radius, 0.7f * height);
  const auto counts = [&](const Vec3f& target) {
    const Vec3f above = target + query.normal * lift;
    Vec3f direction = above - eye;
    ++rays;
    auto hit = scene.intersect({eye, direction, 1.0f});
    if (!hit) {
      direction = -query.normal;
      ++rays;
      hit = scene.intersect({above, direction, lift + kPlaneTolerance * radius});
    }
    if (!hit) return false;
    const float height_of_hit = dot(hit->position - query.position, query.normal);
    const float facing = std::copysign(dot(hit->ng, query.normal), -dot(hit->ng, direction) * dot(hit->ng, query.normal));
    if (std::abs(height_of_hit) > kPlaneTolerance * radius || facing < kMinNormalCosine) return false;
    return stores_photons(scene, *hit, -normalize(direction));
  };
  Coverage coverage;
  int covered = 0;
  for (int i = 0; i < kProbes; ++i) {
    constexpr float kGoldenAngle = 2.39996323f;
    const float r = radius * std::sqrt((static_cast<float>(i) + u.x) / kProbes);
    const float angle = static_cast<float>(i) * kGoldenAngle + 2.0f * kPi * u.y;
    if (counts(query.position + frame.t * (r * std::cos(angle)) + frame.b * (r * std::sin(angle)))) {
      ++covered;
    } else {
      coverage.nearest_gap = std::min(coverage.nearest_gap, r);
    }
  }
  coverage.fraction = static_cast<float>(std::max(covered, 1)) / kProbes;
  return coverage;
}

}  // namespace pf
