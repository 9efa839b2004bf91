#include "worker/photon/splat_kernel.h"

#include "common/math/offset.h"

namespace pf {
namespace {

/// A surface may bulge by this part of the kernel's radius before a sample counts as behind it, as in DiscQuery.
constexpr float kBulge = 0.25f;
/// Slope against the ray up to which the plane at an end is followed to the kernel's rim: beyond, its light is a
/// thousandth.
constexpr float kMaxSlope = 32.0f;
/// Cosine between normals from which on surfaces lie the same way, and how far in front one then has to be, relative to
/// the coordinates: twice what rays are moved off their surfaces.
constexpr float kMinSplatCosine = 0.5f;
constexpr float kClearance = 2.0f * kRayOffset;
/// Rounding of the spread along the ray, so that the cone is a bound.
constexpr float kRadiusMargin = 1.0001f;

/// How many radii the kernel reaches beyond an end: one, or as far as the plane there needs; far where there is none,
/// as the ray itself goes on.
float reach(const RayKernel::Plane& plane, const Vec3f& direction) {
  if (is_zero(plane.normal)) return kMaxSlope;
  const float cosine = std::abs(dot(plane.normal, direction));
  const float sine = std::sqrt(std::max(0.0f, 1.0f - cosine * cosine));
  return std::max(1.0f, sine < kMaxSlope * cosine ? sine / cosine : kMaxSlope);
}

}  // namespace

KernelProfile::KernelProfile(SplatKernel kind) : kind_(kind) {
  // Over half discs: strips across the line, each its chord; the profile's own integral scales the rounding away.
  constexpr int kStrips = 16, kAlong = 64;
  double sum = 0.0;
  for (std::size_t step = kSteps; step-- > 0;) {
    for (int strip = 0; strip < kStrips; ++strip) {
      const double z = (static_cast<double>(step) + (strip + 0.5) / kStrips) / kSteps, chord = std::sqrt(1.0 - z * z);
      for (int i = 0; i < kAlong; ++i) {
        const double v = chord * (i + 0.5) / kAlong;
        sum += double{(*this)(static_cast<float>(z * z + v * v))} * chord;
      }
    }
    beyond_[step] = static_cast<float>(sum);
  }
  for (float& part : beyond_) part *= static_cast<float>(0.5 / sum);
}

RayKernel::RayKernel(const Vec3f& origin, const Vec3f& direction, float length, const Vec3f& axis_x,
                     const Vec3f& axis_y, const Spread& at_start, const Spread& linear, const Spread& quadratic,
                     const Plane& start, const Plane& end)
    : origin_(origin),
      direction_(direction),
      axis_x_(axis_x),
      axis_y_(axis_y),
      length_(length),
      at_start_(at_start),
      linear_(linear),
      quadratic_(quadratic),
      start_(start),
      end_(end),
      first_radius_(kRadiusMargin * std::sqrt(std::max(0.0f, spread(0.0f).largest()))) {
  const float last_radius = kRadiusMargin * std::sqrt(std::max(0.0f, spread(length).largest()));
  radius_slope_ = length > 0.0f ? (last_radius - first_radius_) / length : 0.0f;
  start_reach_ = reach(start, direction);
  end_reach_ = reach(end, direction);
  const float end_cosine = std::abs(dot(end.normal, direction));
  for (int k = 0; k < 3; ++k) {
    constexpr float kLeast = 1e-20f;
    inverse_direction_[k] = 1.0f / std::copysign(std::max(std::abs(direction[k]), kLeast), direction[k]);
  }
  inverse_end_cosine_ = end_cosine > 0.0f ? std::min(1.0f / end_cosine, kMaxSlope) : 0.0f;
}

bool RayKernel::in_front_of_start(const SplatSample& sample, float bulge) const {
  const float height = dot(start_.normal, sample.position) - start_.offset;
  // The other side of a thin sheet, or for light from behind the sheet itself, must not be lit by what leaves the
  // sheet: a surface that lies the same way has to be clearly in front.
  const float facing = dot(start_.normal, sample.ng);
  const bool parallel = facing < -kMinSplatCosine || (sample.both_sides && facing > kMinSplatCosine);
  if (parallel) return height > kClearance * std::max(sample.extent, max_magnitude(sample.position));
  return height > -bulge;
}

/// Where the surface that the ray left and the sample's own meet at an inner edge, as at the foot of a wall, rays
/// through the kernel's disc around the sample would have to start below the sample's plane on one side of a line, and
/// do not exist. With h the sample's height over the surface, c and c' the cosines of the ray at start and sample, n
/// and n' their normals: a ray at offset y exists where y . (n' c + n c') >= -h c'.
float RayKernel::start_edge(const SplatSample& sample, const Spread& m) const {
  if (is_zero(start_.normal) || sample.both_sides) return kInfinity;
  const float cosine = dot(start_.normal, direction_), cosine_there = -dot(sample.ng, direction_);
  const Vec3f across = sample.ng * cosine + start_.normal * cosine_there;
  const float x = dot(across, axis_x_), y = dot(across, axis_y_);
  const float width2 = m.xx * x * x + 2.0f * m.xy * x * y + m.yy * y * y;
  const float distance = std::max(0.0f, dot(start_.normal, sample.position) - start_.offset) * cosine_there;
  return cosine > 0.0f && distance * distance < width2 ? distance / std::sqrt(width2) : kInfinity;
}

std::optional<RayKernel::Meeting> RayKernel::meet_near(const SplatSample& sample, float t, float x, float y) const {
  if (!sample.both_sides && !(dot(direction_, sample.ng) < 0.0f && dot(direction_, sample.ns) < 0.0f))
    return std::nullopt;
  const float on_ray = std::clamp(t, 0.0f, length_);
  // The eye's own footprint is added like the variance of one more blur: no kernel is narrower.
  const float least2 = sample.least_radius * sample.least_radius;
  const Spread m = spread(on_ray) + Spread{least2, 0.0f, least2};
  const float determinant = m.determinant();
  const float scaled = m.yy * x * x - 2.0f * m.xy * x * y + m.xx * y * y;
  if (!(scaled < determinant)) return std::nullopt;
  const float bulge = kBulge * (radius(on_ray) + sample.least_radius);
  if (!is_zero(start_.normal) && !in_front_of_start(sample, bulge)) return std::nullopt;
  const float depth = is_zero(end_.normal) ? 0.0f : end_.offset - dot(end_.normal, sample.position);
  return Meeting{t, scaled / determinant, kPi * std::sqrt(determinant), start_edge(sample, m),
                 depth > bulge ? depth * inverse_end_cosine_ : 0.0f};
}

}  // namespace pf
