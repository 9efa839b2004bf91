#include "worker/photon/photon_differential.h"

#include <cmath>

#include "common/math/frame.h"

namespace pf {
namespace {

/// Cosine below which a spread is not stretched further along a surface that is met edge-on.
constexpr float kLeastCosine = 0.02f;

Vec3f across(const Vec3f& v, const Vec3f& unit) { return v - unit * dot(v, unit); }

float clear_of_zero(float cosine) {
  return std::abs(cosine) > kLeastCosine ? cosine : std::copysign(kLeastCosine, cosine);
}

/// Root of one over a density: the edge of the square that one unit of random numbers covers.
float edge(float pdf) { return pdf > 0.0f ? 1.0f / std::sqrt(pdf) : 0.0f; }

/// Lower triangle L with L L^T = `m` [Cholesky]; a dimension without any spread of its own gives a column of zeros.
using Matrix4 = std::array<std::array<float, 4>, 4>;
Matrix4 root_of(const Matrix4& m) {
  Matrix4 root{};
  for (std::size_t column = 0; column < 4; ++column) {
    float pivot = m[column][column];
    for (std::size_t k = 0; k < column; ++k) pivot -= root[column][k] * root[column][k];
    if (!(pivot > 1e-6f * m[column][column])) continue;
    root[column][column] = std::sqrt(pivot);
    for (std::size_t row = column + 1; row < 4; ++row) {
      float sum = m[row][column];
      for (std::size_t k = 0; k < column; ++k) sum -= root[row][k] * root[column][k];
      root[row][column] = sum / root[column][column];
    }
  }
  return root;
}

}  // namespace

PhotonDifferential PhotonDifferential::emitted(const Vec3f& direction, const Vec3f& plane_normal, float pdf_a,
                                               float pdf_w) {
  PhotonDifferential d;
  d.ray_ = direction;
  const Frame plane = Frame::from_normal(plane_normal);
  const Frame ray = Frame::from_normal(direction);
  d.position_ = {across(plane.t * edge(pdf_a), direction), across(plane.b * edge(pdf_a), direction), Vec3f(0.0f),
                 Vec3f(0.0f)};
  d.direction_ = {Vec3f(0.0f), Vec3f(0.0f), ray.t * edge(pdf_w), ray.b * edge(pdf_w)};
  return d;
}

void PhotonDifferential::advance(float distance) {
  for (std::size_t k = 0; k < kAxes; ++k) position_[k] += direction_[k] * distance;
}

void PhotonDifferential::meet(const Vec3f& ng) {
  const float cosine = clear_of_zero(dot(ray_, ng));
  for (Vec3f& p : position_) p -= ray_ * (dot(p, ng) / cosine);
}

void PhotonDifferential::leave(const Vec3f& to) {
  ray_ = to;
  for (std::size_t k = 0; k < kAxes; ++k) {
    position_[k] = across(position_[k], to);
    direction_[k] = across(direction_[k], to);
  }
}

void PhotonDifferential::reflect(const Vec3f& ng, const Vec3f& normal, const SurfaceShape& shape, const Vec3f& to) {
  meet(ng);
  const float cosine = dot(ray_, normal);
  // The shape's normal may lie on the other side of the surface than `normal`.
  const float side = dot(ng, normal) < 0.0f ? -1.0f : 1.0f;
  for (std::size_t k = 0; k < kAxes; ++k) {
    const Vec3f dn = shape.normal_change(position_[k]) * side;
    const float turned = dot(direction_[k], normal) + dot(ray_, dn);
    direction_[k] -= (dn * cosine + normal * turned) * 2.0f;
  }
  leave(to);
}

void PhotonDifferential::refract(const Vec3f& ng, const Vec3f& normal, const SurfaceShape& shape, float eta_i,
                                 float eta_t, const Vec3f& to) {
  meet(ng);
  const float side = dot(ng, normal) < 0.0f ? -1.0f : 1.0f;
  const float eta = eta_i / eta_t;
  const float cos_in = dot(ray_, normal);
  const float cos_out = clear_of_zero(dot(to, normal));
  const float mu = eta * cos_in - cos_out;
  const float slope = eta - eta * eta * cos_in / cos_out;
  for (std::size_t k = 0; k < kAxes; ++k) {
    const Vec3f dn = shape.normal_change(position_[k]) * side;
    const float turned = dot(direction_[k], normal) + dot(ray_, dn);
    direction_[k] = direction_[k] * eta - (dn * mu + normal * (slope * turned));
  }
  leave(to);
}

void PhotonDifferential::turn(const Vec3f& to) {
  // The rotation that takes the one direction into the other, or for opposite ones, a reflection.
  const float cosine = dot(ray_, to);
  const Vec3f axis = cross(ray_, to);
  const auto rotated = [&](const Vec3f& v) {
    if (cosine < -0.999f) return across(v, to);
    return v * cosine + cross(axis, v) + axis * (dot(axis, v) / (1.0f + cosine));
  };
  for (std::size_t k = 0; k < kAxes; ++k) {
    position_[k] = rotated(position_[k]);
    direction_[k] = rotated(direction_[k]);
  }
  ray_ = to;
}

void PhotonDifferential::bounce(const Vec3f& ng, const Vec3f& to, float pdf_w) {
  meet(ng);
  direction_.fill(Vec3f(0.0f));
  leave(to);
  roughen(pdf_w);
}

void PhotonDifferential::roughen(float pdf_w) {
  // Covariances of independent spreads add up; the four vectors are a root of the sum.
  const Frame frame = Frame::from_normal(ray_);
  Matrix4 covariance{};
  for (std::size_t k = 0; k < kAxes; ++k) {
    const std::array<float, 4> v{dot(position_[k], frame.t), dot(position_[k], frame.b), dot(direction_[k], frame.t),
                                 dot(direction_[k], frame.b)};
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = 0; j < 4; ++j) covariance[i][j] += v[i] * v[j];
    }
  }
  const float added = edge(pdf_w) * edge(pdf_w);
  covariance[2][2] += added;
  covariance[3][3] += added;
  const Matrix4 root = root_of(covariance);
  for (std::size_t k = 0; k < kAxes; ++k) {
    position_[k] = frame.t * root[0][k] + frame.b * root[1][k];
    direction_[k] = frame.t * root[2][k] + frame.b * root[3][k];
  }
}

PhotonDifferential::Along PhotonDifferential::along(const Vec3f& axis_x, const Vec3f& axis_y) const {
  Along a;
  for (std::size_t k = 0; k < kAxes; ++k) {
    const float px = dot(position_[k], axis_x), py = dot(position_[k], axis_y);
    const float dx = dot(direction_[k], axis_x), dy = dot(direction_[k], axis_y);
    a.at_start += Spread{px * px, px * py, py * py};
    a.linear += Spread{2.0f * px * dx, px * dy + py * dx, 2.0f * py * dy};
    a.quadratic += Spread{dx * dx, dx * dy, dy * dy};
  }
  return a;
}

}  // namespace pf
