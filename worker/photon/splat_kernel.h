#pragma once

#include <immintrin.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "common/math/vec.h"
#include "common/spec/job_spec.h"

namespace pf {

/// Radial profile f of a kernel K(x) = f(u) / (pi sqrt(det M)) over the ellipse u^2 = x^T M^-1 x < 1, normalised over
/// the disc: 2 * integral of f(u) u du = 1 over [0, 1].
class KernelProfile {
 public:
  explicit KernelProfile(SplatKernel kind);

  /// f at the squared relative distance `u2`; 0 from 1 on.
  [[nodiscard]] float operator()(float u2) const {
    if (!(u2 < 1.0f)) return 0.0f;
    switch (kind_) {
      case SplatKernel::kEpanechnikov:
        return 2.0f * (1.0f - u2);
      case SplatKernel::kCone:
        return 3.0f * (1.0f - std::sqrt(u2));
      case SplatKernel::kGaussian:
        return kGaussianPeak * std::exp(-kGaussianFall * u2);
    }
    return 0.0f;
  }
  /// Part of the kernel beyond a straight line at relative distance `s` >= 0 from its middle: 1/2 at 0, 0 from 1 on.
  [[nodiscard]] float beyond(float s) const {
    if (!(s < 1.0f)) return 0.0f;
    const float at = s * static_cast<float>(kSteps);
    const auto step = static_cast<std::size_t>(at);
    const float rest = at - static_cast<float>(step);
    return beyond_[step] * (1.0f - rest) + beyond_[step + 1] * rest;
  }

 private:
  static constexpr std::size_t kSteps = 64;
  /// The rim is three standard deviations out: exp(-9/2) of the peak.
  static constexpr float kGaussianFall = 4.5f;
  static constexpr float kGaussianPeak = 4.5f / 0.98889100f;  ///< fall / (1 - exp(-fall))

  SplatKernel kind_;
  std::array<float, kSteps + 2> beyond_{};  ///< by s in steps; one more for s rounded up to 1
};

/// Symmetric 2 x 2 matrix: squared half axes of an ellipse [m^2].
struct Spread {
  float xx = 0, xy = 0, yy = 0;

  [[nodiscard]] float determinant() const { return std::max(0.0f, xx * yy - xy * xy); }
  /// Squared half of the long axis.
  [[nodiscard]] float largest() const {
    const float half = 0.5f * (xx - yy);
    return 0.5f * (xx + yy) + std::sqrt(half * half + xy * xy);
  }
  Spread& operator+=(const Spread& o) {
    xx += o.xx, xy += o.xy, yy += o.yy;
    return *this;
  }
  friend Spread operator+(Spread a, const Spread& b) { return a += b; }
  friend Spread operator*(const Spread& a, float s) { return {a.xx * s, a.xy * s, a.yy * s}; }
};

/// Where an eye path gathers: what splatting asks of it.
struct SplatSample {
  Vec3f position;
  Vec3f ng;                 ///< unit geometric normal on the side that is seen
  Vec3f ns;                 ///< shading normal, likewise
  float least_radius = 0;   ///< [m] of the eye's own footprint: no kernel is narrower
  float extent = 0;         ///< SurfacePoint::extent: for offsets of rays
  bool both_sides = false;  ///< also light from behind counts (rough transmission)
  std::uint32_t id = 0;     ///< the caller's
};

/// Sixteen samples side by side, a field two vector registers; unused places lie infinitely far away.
struct alignas(32) SampleBlock {
  static constexpr std::size_t kWidth = 16;
  std::array<float, kWidth> x, y, z, least_radius;
};

/// The kernel around one photon ray: an ellipse in the plane across the ray, which varies along it as the spread of the
/// paths around this one does.
///
/// [Herzog et al. 2007]: flux spread over the disc ACROSS the ray gives the flux density that arrives at any sample
/// near the ray, however its surface is turned; the sample's own cosine makes it irradiance. So a ray that passes
/// beside the edge of a table still counts on the table, and no light is missing at an edge.
class RayKernel {
 public:
  /// A surface at one end of the ray: samples behind it do not count. `normal`: on the ray's side.
  struct Plane {
    Vec3f normal{0, 0, 0};  ///< zero: no surface there
    float offset = 0;       ///< dot(normal, point)
  };

  RayKernel() = default;
  /// `at_start`, `linear`, `quadratic`: the spread at distance t is at_start + t linear + t^2 quadratic, along `axis_x`
  /// and `axis_y`, which with `direction` are orthonormal.
  RayKernel(const Vec3f& origin, const Vec3f& direction, float length, const Vec3f& axis_x, const Vec3f& axis_y,
            const Spread& at_start, const Spread& linear, const Spread& quadratic, const Plane& start,
            const Plane& end);

  /// How a sample lies in the kernel.
  struct Meeting {
    float t;       ///< distance of its foot along the ray; may lie a little before or beyond the ray
    float u2;      ///< squared relative distance from the axis, < 1
    float area;    ///< of the ellipse there [m^2]
    float edge;    ///< relative distance of the edge below which no rays start (start_edge)
    float behind;  ///< how far back along the ray the plane of the surface that the ray met is; 0: not behind it
  };
  /// Empty where the sample faces away, lies outside the kernel, or behind the surface at the start.
  [[nodiscard]] std::optional<Meeting> meet(const SplatSample& sample) const {
    const Vec3f away = sample.position - origin_;
    const float t = dot(away, direction_);
    const float x = dot(away, axis_x_);
    const float y = dot(away, axis_y_);
    const float bound = radius(t) + sample.least_radius;
    if (!(x * x + y * y < bound * bound) || !(t >= t_begin(sample.least_radius) && t <= t_end(sample.least_radius)))
      return std::nullopt;
    return meet_near(sample, t, x, y);
  }

  /// Bits of the samples of a block that lie within the circle around the ellipse: the first test of meet(), to the
  /// bit, which most of those that a walk comes to fail.
  [[nodiscard]] std::uint32_t near(const SampleBlock& block) const {
    const auto all = [](float v) { return _mm256_set1_ps(v); };
    const auto dot8 = [&](__m256 x, __m256 y, __m256 z, const Vec3f& v) {
      return _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(x, all(v.x)), _mm256_mul_ps(y, all(v.y))),
                           _mm256_mul_ps(z, all(v.z)));
    };
    std::uint32_t bits = 0;
    for (std::size_t i = 0; i < SampleBlock::kWidth; i += 8) {
      const __m256 away_x = _mm256_sub_ps(_mm256_load_ps(&block.x[i]), all(origin_.x));
      const __m256 away_y = _mm256_sub_ps(_mm256_load_ps(&block.y[i]), all(origin_.y));
      const __m256 away_z = _mm256_sub_ps(_mm256_load_ps(&block.z[i]), all(origin_.z));
      const __m256 t = dot8(away_x, away_y, away_z, direction_);
      const __m256 x = dot8(away_x, away_y, away_z, axis_x_);
      const __m256 y = dot8(away_x, away_y, away_z, axis_y_);
      const __m256 on_ray = _mm256_min_ps(_mm256_max_ps(t, all(0.0f)), all(length_));
      const __m256 radius = _mm256_add_ps(all(first_radius_), _mm256_mul_ps(all(radius_slope_), on_ray));
      const __m256 bound = _mm256_add_ps(radius, _mm256_load_ps(&block.least_radius[i]));
      const __m256 across2 = _mm256_add_ps(_mm256_mul_ps(x, x), _mm256_mul_ps(y, y));
      const int inside = _mm256_movemask_ps(_mm256_cmp_ps(across2, _mm256_mul_ps(bound, bound), _CMP_LT_OQ));
      bits |= static_cast<std::uint32_t>(inside) << i;
    }
    return bits;
  }

  [[nodiscard]] const Vec3f& origin() const { return origin_; }
  [[nodiscard]] const Vec3f& direction() const { return direction_; }
  /// One over each component of the direction; finite, so that a slab test needs no special case.
  [[nodiscard]] const Vec3f& inverse_direction() const { return inverse_direction_; }
  [[nodiscard]] float length() const { return length_; }
  [[nodiscard]] const Plane& start() const { return start_; }
  [[nodiscard]] Spread spread(float t) const { return at_start_ + linear_ * t + quadratic_ * (t * t); }
  /// Bound of the long half axis at `t` [m]. The half axis is convex in t, so the chord between the ends bounds it: a
  /// cone.
  [[nodiscard]] float radius(float t) const { return first_radius_ + radius_slope_ * std::clamp(t, 0.0f, length_); }
  /// Range of t in which the feet of samples of this least radius lie: a tilted surface at an end goes on beside the
  /// ray.
  [[nodiscard]] float t_begin(float least_radius) const { return -start_reach_ * (radius(0.0f) + least_radius); }
  [[nodiscard]] float t_end(float least_radius) const {
    return length_ + end_reach_ * (radius(length_) + least_radius);
  }

 private:
  [[nodiscard]] std::optional<Meeting> meet_near(const SplatSample& sample, float t, float x, float y) const;
  [[nodiscard]] float start_edge(const SplatSample& sample, const Spread& m) const;
  [[nodiscard]] bool in_front_of_start(const SplatSample& sample, float bulge) const;

  Vec3f origin_, direction_, inverse_direction_, axis_x_, axis_y_;
  float length_ = 0;
  Spread at_start_, linear_, quadratic_;
  Plane start_, end_;
  float first_radius_ = 0, radius_slope_ = 0;
  float start_reach_ = 0, end_reach_ = 0;  ///< beyond the ends, in radii
  float inverse_end_cosine_ = 0;
};

}  // namespace pf
