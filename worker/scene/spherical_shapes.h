#pragma once

#include <Imath/ImathVec.h>

#include "common/math/vec.h"

namespace pf {

/// Sampling of flat shapes uniformly by the solid angle under which a point sees them. In double: the angles
/// of a spherical polygon cancel to its area.

using Vec3d = Imath::V3d;

/// Solid angle [sr] of the triangle whose corners lie at `a`, `b`, `c` as seen from the origin
/// [Van Oosterom and Strackee 1983, eq. 8]. 0 where the origin lies in its plane.
[[nodiscard]] double triangle_solid_angle(const Vec3d& a, const Vec3d& b, const Vec3d& c);

/// Unit direction, uniform over the triangle's solid angle: u.x cuts off a part of the area next to side ab,
/// u.y goes along the cut [Arvo 1995, "Stratified Sampling of Spherical Triangles"; the algebra of
/// pbrt-v4 6.5.4].
[[nodiscard]] Vec3d sample_spherical_triangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec2f& u);

/// A rectangle seen from the origin [Urena, Fajardo and King 2013, "An Area-Preserving Parametrization for
/// Spherical Rectangles", listings 1 and 2].
class SphericalRectangle {
 public:
  /// Corner and the two edges that start there (at right angles).
  SphericalRectangle(const Vec3d& corner, const Vec3d& edge_u, const Vec3d& edge_v);
  [[nodiscard]] double solid_angle() const { return solid_angle_; }
  /// Point corner + s edge_u + t edge_v, returned as (s, t), uniform over the solid angle.
  [[nodiscard]] Vec2f sample(const Vec2f& u) const;

 private:
  double x0_, y0_, z0_, x1_, y1_;  ///< the rectangle in its own frame, z0 <= 0
  double b0_, b1_, k_, solid_angle_;
};

}  // namespace pf
