#include "worker/photon/covered_area.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "common/math/frame.h"

namespace pf {
namespace {

/// A lamp or a mirror flush with the surface leaves a hole in the disc: no photon is ever stored there.
bool stores_photons(const Scene& scene, const SurfacePoint& point, const Vec3f& wo) {
  const Bsdf bsdf(scene.evaluate(point, 1.0f), wo);
  return !bsdf.is_black() && !bsdf.is_delta_only();
}

}  // namespace

Coverage measure_coverage(const Scene& scene, const SurfacePoint& point, const DiscQuery& query,
                          const Vec2f& u, std::uint64_t& rays, int probes) {
  const float radius = std::sqrt(query.radius2);
  const Frame frame = Frame::from_normal(query.normal);
  const Vec3f start = offset_past(point, query.normal);

  // Probes start this part of the radius above the surface: high enough to see the disc over slightly curved
  // ground, low enough to be stopped by what stands on it; lower where something lies close above.
  constexpr float kHeight = 0.35f;
  float height = kHeight * radius;
  ++rays;
  if (const auto above = scene.intersect({start, query.normal, height})) height = 0.5f * above->t;
  const Vec3f eye = start + query.normal * height;

  // Each probe goes to a point a little above the disc, where walls may stop it, and from there straight
  // down: a slanted one alone would pass over ground that falls away, as on a ball of a few disc radii.
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
    const float facing =
        std::copysign(dot(hit->ng, query.normal), -dot(hit->ng, direction) * dot(hit->ng, query.normal));
    if (std::abs(height_of_hit) > kPlaneTolerance * radius || facing < kMinNormalCosine) return false;
    return stores_photons(scene, *hit, -normalize(direction));
  };
  Coverage coverage;
  int covered = 0;
  for (int i = 0; i < probes; ++i) {
    constexpr float kGoldenAngle = 2.39996323f;
    const float r = radius * std::sqrt((static_cast<float>(i) + u.x) / static_cast<float>(probes));
    const float angle = static_cast<float>(i) * kGoldenAngle + 2.0f * kPi * u.y;
    if (counts(query.position + frame.t * (r * std::cos(angle)) + frame.b * (r * std::sin(angle)))) {
      ++covered;
    } else {
      coverage.nearest_gap = std::min(coverage.nearest_gap, r);
    }
  }
  coverage.fraction = static_cast<float>(std::max(covered, 1)) / static_cast<float>(probes);
  return coverage;
}

namespace {

/// Lower bound of the distance to the nearest gap: neighbouring ones of kProbes stand about a quarter of the
/// radius apart on either side.
float safe_distance(const Coverage& coverage, float radius) {
  return coverage.fraction >= 1.0f ? kInfinity : std::max(0.0f, coverage.nearest_gap - 0.25f * radius);
}

/// Distance of `disc` from `middle` when both lie on one surface and near each other, else infinity.
float distance_on_surface(const GatherDisc& middle, const GatherDisc& disc) {
  constexpr float kReach = 0.5f;       // of the radius
  constexpr float kMinCosine = 0.98f;  // curvature that leaves the wider disc about as flat
  constexpr float kMaxHeight = 0.1f;   // of the radius
  const Vec3f d = disc.query.position - middle.query.position;
  const float radius2 = middle.query.radius2;
  const float height = dot(d, middle.query.normal);
  const bool near = length2(d) <= kReach * kReach * radius2 &&
                    height * height <= kMaxHeight * kMaxHeight * radius2 &&
                    dot(disc.query.normal, middle.query.normal) >= kMinCosine;
  return near ? length(d) : kInfinity;
}

}  // namespace

void find_covered_radii(const Scene& scene, std::span<GatherDisc> discs, std::uint64_t& rays) {
  // A gap hides more easily between the probes of a wide disc; many discs share them.
  constexpr int kSharedProbes = 2 * kProbes;
  std::vector<std::size_t> left(discs.size());
  std::iota(left.begin(), left.end(), std::size_t{0});
  std::vector<std::size_t> group;
  while (!left.empty()) {
    const GatherDisc& middle = discs[left[left.size() / 2]];
    group.clear();
    float reach = 0.0f;
    std::erase_if(left, [&](std::size_t i) {
      const float distance = distance_on_surface(middle, discs[i]);
      if (distance == kInfinity) return false;
      group.push_back(i);
      reach = std::max(reach, distance + std::sqrt(discs[i].query.radius2));
      return true;
    });
    float safe = 0.0f;
    if (group.size() > 1) {
      DiscQuery wide = middle.query;
      wide.radius2 = reach * reach;
      safe = safe_distance(measure_coverage(scene, middle.point, wide, middle.u, rays, kSharedProbes), reach);
    }
    for (const std::size_t i : group) {
      GatherDisc& disc = discs[i];
      const float radius = std::sqrt(disc.query.radius2);
      const bool whole = distance_on_surface(middle, disc) + radius <= safe;
      disc.covered_radius =
          whole ? kInfinity
                : safe_distance(measure_coverage(scene, disc.point, disc.query, disc.u, rays), radius);
    }
  }
}

}  // namespace pf
