#include "worker/scene/spherical_shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace pf {
namespace {

constexpr double kPiD = std::numbers::pi;

/// Angle between unit vectors, exact near 0 and pi [Kahan; pbrt-v4 3.3.2].
double angle_between(const Vec3d& a, const Vec3d& b) {
  if (a.dot(b) < 0.0) return kPiD - 2.0 * std::asin(std::min(1.0, (a + b).length() * 0.5));
  return 2.0 * std::asin(std::min(1.0, (b - a).length() * 0.5));
}

Vec3d orthogonal_part(const Vec3d& v, const Vec3d& unit) { return (v - unit * v.dot(unit)).normalized(); }

double safe_sqrt(double x) { return std::sqrt(std::max(0.0, x)); }

}  // namespace

double triangle_solid_angle(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const double la = a.length(), lb = b.length(), lc = c.length();
  const double volume = std::abs(a.dot(b.cross(c)));
  const double denominator = la * lb * lc + a.dot(b) * lc + a.dot(c) * lb + b.dot(c) * la;
  return 2.0 * std::atan2(volume, denominator);
}

Vec3d sample_spherical_triangle(const Vec3d& a_in, const Vec3d& b_in, const Vec3d& c_in, const Vec2f& u) {
  const Vec3d a = a_in.normalized(), b = b_in.normalized(), c = c_in.normalized();
  // Angles at the corners, between the planes of the sides.
  const Vec3d n_ab = a.cross(b).normalized(), n_bc = b.cross(c).normalized(), n_ca = c.cross(a).normalized();
  const double alpha = angle_between(n_ab, -n_ca);
  const double beta = angle_between(n_bc, -n_ab);
  const double gamma = angle_between(n_ca, -n_bc);
  // Area of the sub-triangle a, b, c' plus pi; c' lies on the side from a to c.
  const double area_pi = kPiD + static_cast<double>(u.x) * (alpha + beta + gamma - kPiD);

  const double cos_alpha = std::cos(alpha), sin_alpha = std::sin(alpha);
  const double sin_phi = std::sin(area_pi) * cos_alpha - std::cos(area_pi) * sin_alpha;
  const double cos_phi = std::cos(area_pi) * cos_alpha + std::sin(area_pi) * sin_alpha;
  const double k1 = cos_phi + cos_alpha;
  const double k2 = sin_phi - sin_alpha * a.dot(b);
  const double cos_side = std::clamp(
      (k2 + (k2 * cos_phi - k1 * sin_phi) * cos_alpha) / ((k2 * sin_phi + k1 * cos_phi) * sin_alpha), -1.0, 1.0);
  const Vec3d c_cut = a * cos_side + orthogonal_part(c, a) * safe_sqrt(1.0 - cos_side * cos_side);

  const double cos_theta = 1.0 - static_cast<double>(u.y) * (1.0 - c_cut.dot(b));
  return b * cos_theta + orthogonal_part(c_cut, b) * safe_sqrt(1.0 - cos_theta * cos_theta);
}

SphericalRectangle::SphericalRectangle(const Vec3d& corner, const Vec3d& edge_u, const Vec3d& edge_v) {
  const double length_u = edge_u.length(), length_v = edge_v.length();
  const Vec3d x = edge_u / length_u, y = edge_v / length_v, z = x.cross(y);
  x0_ = corner.dot(x);
  y0_ = corner.dot(y);
  z0_ = -std::abs(corner.dot(z));
  x1_ = x0_ + length_u;
  y1_ = y0_ + length_v;
  // Normals of the planes through the origin and each edge; only their z, and angles between neighbours, are
  // needed.
  const Vec3d v00(x0_, y0_, z0_), v01(x0_, y1_, z0_), v10(x1_, y0_, z0_), v11(x1_, y1_, z0_);
  const Vec3d n0 = v00.cross(v10).normalized(), n1 = v10.cross(v11).normalized();
  const Vec3d n2 = v11.cross(v01).normalized(), n3 = v01.cross(v00).normalized();
  const double g0 = std::acos(std::clamp(-n0.dot(n1), -1.0, 1.0)), g1 = std::acos(std::clamp(-n1.dot(n2), -1.0, 1.0));
  const double g2 = std::acos(std::clamp(-n2.dot(n3), -1.0, 1.0)), g3 = std::acos(std::clamp(-n3.dot(n0), -1.0, 1.0));
  b0_ = n0.z;
  b1_ = n2.z;
  k_ = 2.0 * kPiD - g2 - g3;
  solid_angle_ = g0 + g1 - k_;
}

Vec2f SphericalRectangle::sample(const Vec2f& u) const {
  const double au = static_cast<double>(u.x) * solid_angle_ + k_;
  const double fu = (std::cos(au) * b0_ - b1_) / std::sin(au);
  const double cu = std::clamp(std::copysign(1.0 / std::sqrt(fu * fu + b0_ * b0_), fu), -1.0, 1.0);
  const double xu = std::clamp(-(cu * z0_) / std::max(safe_sqrt(1.0 - cu * cu), 1e-300), x0_, x1_);

  const double d2 = xu * xu + z0_ * z0_;
  const double h0 = y0_ / std::sqrt(d2 + y0_ * y0_), h1 = y1_ / std::sqrt(d2 + y1_ * y1_);
  const double hv = h0 + static_cast<double>(u.y) * (h1 - h0);
  const double yv = hv * hv < 1.0 - 1e-12 ? hv * std::sqrt(d2) / std::sqrt(1.0 - hv * hv) : y1_;
  return {static_cast<float>(std::clamp((xu - x0_) / (x1_ - x0_), 0.0, 1.0)),
          static_cast<float>(std::clamp((yv - y0_) / (y1_ - y0_), 0.0, 1.0))};
}

}  // namespace pf
