#include "worker/photon/covered_area.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <span>
#include <vector>

#include "common/math/frame.h"
#include "common/math/lanes.h"
#include "worker/scene/surface_lanes.h"

namespace pf {
namespace {

/// A lamp or a mirror flush with the surface leaves a hole in the disc: no photon is ever stored there.
bool stores_photons(const Scene& scene, const SurfacePoint& point, const Vec3f& wo) {
  if (const Rgb* albedo = scene.plain_lambert(point.material)) return !is_zero(*albedo);
  const Bsdf bsdf(scene.evaluate(point, 1.0f), wo);
  return !bsdf.is_black() && !bsdf.is_delta_only();
}

/// Where the probes go in a disc of radius 1: the golden angle apart along Vogel's spiral, sixteen or more directions
/// of it.
struct Spiral {
  static constexpr std::size_t kMost = 2 * kProbes;
  alignas(32) std::array<float, kMost> cosine, sine;
  Spiral() {
    constexpr double kGoldenAngle = 2.39996322972865332;
    for (std::size_t i = 0; i < kMost; ++i) {
      cosine[i] = static_cast<float>(std::cos(kGoldenAngle * static_cast<double>(i)));
      sine[i] = static_cast<float>(std::sin(kGoldenAngle * static_cast<double>(i)));
    }
  }
};
const Spiral kSpiral;

/// Probes into the disc of a query, eight at once. Each goes from `eye`, above the hit point, to a point a little above
/// the disc, where walls may stop it, and from there straight down: a slanted one alone would pass over ground that
/// falls away, as on a ball of a few disc radii.
class Probes {
 public:
  Probes(const Scene& scene, const DiscQuery& query, float radius, const Vec3f& eye, float lift)
      : scene_(scene), query_(query), radius_(radius), eye_(eye), lift_(lift) {}

  /// Lanes whose probe counts.
  [[nodiscard]] unsigned count(const Vec3x8& targets, std::uint64_t& rays) const {
    const Vec3x8 above = targets + all(query_.normal) * all(lift_);
    const RayLanes out{all(eye_), above - all(eye_), all(1.0f), true};
    unsigned counted = shoot(out, kAllLanes, rays);
    const unsigned stopped = met_.hits;
    const RayLanes down{above, all(-query_.normal), all(lift_ + kPlaneTolerance * radius_), true};
    if (stopped != kAllLanes) counted |= shoot(down, kAllLanes & ~stopped, rays);
    return counted;
  }

 private:
  /// Lanes that meet a surface on which the query would accept a photon.
  [[nodiscard]] unsigned shoot(const RayLanes& probes, unsigned lanes, std::uint64_t& rays) const {
    rays += static_cast<std::uint64_t>(std::popcount(lanes));
    scene_.intersect(std::span(&probes, 1), std::span(&lanes, 1), std::span(&met_, 1));
    unsigned counted = 0;
    for_each_lane(met_.hits, [&](std::size_t lane) {
      const Vec3f direction = probes.direction[lane], ng = met_.ng[lane];
      const float height = dot(met_.position[lane] - query_.position, query_.normal);
      const float cosine = dot(ng, query_.normal);
      const float facing = std::copysign(cosine, -dot(ng, direction) * cosine);
      if (std::abs(height) > kPlaneTolerance * radius_ || facing < kMinNormalCosine) return;
      if (stores_photons(scene_, met_.point(lane), -normalize(direction))) counted |= 1u << lane;
    });
    return counted;
  }

  const Scene& scene_;
  const DiscQuery& query_;
  float radius_;
  Vec3f eye_;
  float lift_;
  mutable SurfaceLanes met_;  ///< by the last rays
};

}  // namespace

Coverage measure_coverage(const Scene& scene, const SurfacePoint& point, const DiscQuery& query, const Vec2f& u,
                          std::uint64_t& rays, int probes) {
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
  const Probes into_disc(scene, query, radius, eye, std::min(kPlaneTolerance * radius, 0.7f * height));

  Coverage coverage;
  int covered = 0;
  const float turn_x = std::cos(2.0f * kPi * u.y), turn_y = std::sin(2.0f * kPi * u.y);
  for (int first = 0; first < probes; first += kLanes) {
    const Float8 number = Float8{0, 1, 2, 3, 4, 5, 6, 7} + static_cast<float>(first);
    const Float8 r = radius * sqrt((number + u.x) / static_cast<float>(probes));
    const Float8 cosine = _mm256_load_ps(&kSpiral.cosine[static_cast<std::size_t>(first)]);
    const Float8 sine = _mm256_load_ps(&kSpiral.sine[static_cast<std::size_t>(first)]);
    const Vec3x8 targets = all(query.position) + all(frame.t) * (r * (cosine * turn_x - sine * turn_y)) +
                           all(frame.b) * (r * (cosine * turn_y + sine * turn_x));
    const unsigned counted = into_disc.count(targets, rays);
    covered += std::popcount(counted);
    for_each_lane(kAllLanes & ~counted,
                  [&](std::size_t lane) { coverage.nearest_gap = std::min(coverage.nearest_gap, r[lane]); });
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
  const bool near = length2(d) <= kReach * kReach * radius2 && height * height <= kMaxHeight * kMaxHeight * radius2 &&
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
          whole ? kInfinity : safe_distance(measure_coverage(scene, disc.point, disc.query, disc.u, rays), radius);
    }
  }
}

}  // namespace pf
