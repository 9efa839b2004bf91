#include "worker/scene/area_light.h"

#include <algorithm>
#include <cmath>

#include "common/math/offset.h"
#include "common/math/sampling.h"
#include "worker/scene/spherical_shapes.h"

namespace pf {
namespace {

/// Solid angle [sr] above which an emitter is sampled by solid angle. Below it, cosine and squared distance
/// vary little over the emitter, and uniform sampling by area is as good and several times cheaper.
constexpr double kLargeSolidAngle = 0.02;
/// Relative error of corners and angles up to which two triangles count as a parallelogram or rectangle.
constexpr float kShapeTolerance = 1e-5f;

Vec3d relative(const Vec3f& point, const Vec3f& origin) { return Vec3d(point) - Vec3d(origin); }

std::array<Vec3f, 3> corners(const EmissiveTriangle& t) { return {t.p0, t.p1, t.p2}; }

float doubled_area(const EmissiveTriangle& t) { return length(cross(t.p1 - t.p0, t.p2 - t.p0)); }

bool shines(const EmissiveTriangle& t) {
  const float area = doubled_area(t);
  return area > 0.0f && std::isfinite(area) && is_finite(t.radiance) && min_component(t.radiance) >= 0.0f &&
         average(t.radiance) > 0.0f;
}

/// Where the direction `w` from `p` meets the plane of origin, edge_u, edge_v: (s, t), kept inside the
/// triangle.
Vec2f meet_triangle(const Vec3d& origin, const Vec3d& edge_u, const Vec3d& edge_v, const Vec3d& w) {
  const Vec3d h = w.cross(edge_v);
  const double determinant = edge_u.dot(h);
  double s = -origin.dot(h) / determinant;
  double t = w.dot((-origin).cross(edge_u)) / determinant;
  if (!std::isfinite(s) || !std::isfinite(t)) return {1.0f / 3.0f, 1.0f / 3.0f};
  s = std::clamp(s, 0.0, 1.0);
  t = std::clamp(t, 0.0, 1.0 - s);
  return {static_cast<float>(s), static_cast<float>(t)};
}

}  // namespace

/// An edge that exactly two triangles share: their indices, and the corner of each that lies off the edge.
struct AreaLight::SharedEdge {
  std::uint32_t a = 0, b = 0;
  std::uint8_t corner_a = 0, corner_b = 0;
};

AreaLight::AreaLight(const EmissiveTriangle& like, const Vec3f& origin, const Vec3f& edge_u, const Vec3f& edge_v,
                     int count)
    : origin_(origin),
      edge_u_(edge_u),
      edge_v_(edge_v),
      ng_(like.ng),
      radiance_(like.radiance),
      two_sided_(like.two_sided),
      count_(static_cast<std::uint8_t>(count)) {
  const Box3f bounds = box();
  center_ = bounds.center();
  radius_ = 0.5f * length(bounds.size());
  area_ = length(cross(edge_u, edge_v)) * (count == 2 ? 1.0f : 0.5f);
  extent_ = std::max(max_magnitude(bounds.min), max_magnitude(bounds.max));
  rectangle_ = count == 2 && std::abs(dot(edge_u, edge_v)) <= kShapeTolerance * length(edge_u) * length(edge_v);
}

AreaLight::AreaLight(const EmissiveTriangle& triangle, std::uint32_t index)
    : AreaLight(triangle, triangle.p0, triangle.p1 - triangle.p0, triangle.p2 - triangle.p0, 1) {
  triangles_ = {index, index};
}

std::vector<AreaLight::SharedEdge> AreaLight::shared_edges(std::span<const EmissiveTriangle> triangles,
                                                           const std::vector<bool>& usable) {
  struct Side {
    std::array<float, 6> key;  ///< both ends, in order of their coordinates
    std::uint32_t triangle;
    std::uint8_t corner;
  };
  std::vector<Side> sides;
  for (std::uint32_t i = 0; i < triangles.size(); ++i) {
    if (!usable[i]) continue;
    const auto p = corners(triangles[i]);
    for (std::uint8_t corner = 0; corner < 3; ++corner) {
      std::array<std::array<float, 3>, 2> ends;
      for (std::size_t e = 0; e < 2; ++e) {
        const Vec3f& v = p[(corner + 1 + e) % 3];
        ends[e] = {v.x, v.y, v.z};
      }
      if (ends[1] < ends[0]) std::swap(ends[0], ends[1]);
      sides.push_back({{ends[0][0], ends[0][1], ends[0][2], ends[1][0], ends[1][1], ends[1][2]}, i, corner});
    }
  }
  std::sort(sides.begin(), sides.end(),
            [](const Side& a, const Side& b) { return a.key != b.key ? a.key < b.key : a.triangle < b.triangle; });
  std::vector<SharedEdge> edges;
  for (std::size_t first = 0, last = 0; first < sides.size(); first = last) {
    while (last < sides.size() && sides[last].key == sides[first].key) ++last;
    if (last - first != 2) continue;  // a border, or a fold where more than two sheets meet
    edges.push_back({sides[first].triangle, sides[first + 1].triangle, sides[first].corner, sides[first + 1].corner});
  }
  std::sort(edges.begin(), edges.end(),
            [](const SharedEdge& x, const SharedEdge& y) { return std::pair(x.a, x.b) < std::pair(y.a, y.b); });
  return edges;
}

std::optional<AreaLight> AreaLight::pair(std::span<const EmissiveTriangle> triangles, const SharedEdge& edge) {
  const EmissiveTriangle& a = triangles[edge.a];
  const EmissiveTriangle& b = triangles[edge.b];
  if (a.radiance != b.radiance || a.two_sided != b.two_sided || dot(a.ng, b.ng) < 0.999f) return std::nullopt;
  const auto pa = corners(a), pb = corners(b);
  const std::size_t ca = edge.corner_a, cb = edge.corner_b;
  const Vec3f edge_u = pa[(ca + 1) % 3] - pa[ca], edge_v = pa[(ca + 2) % 3] - pa[ca];
  const Vec3f far_corner = pa[ca] + edge_u + edge_v;
  const float tolerance = kShapeTolerance * (max_magnitude(edge_u) + max_magnitude(edge_v));
  if (max_magnitude(far_corner - pb[cb]) > tolerance) return std::nullopt;  // so that it is flat as well

  AreaLight light(a, pa[ca], edge_u, edge_v, 2);
  light.triangles_ = {edge.a, edge.b};
  // In the second triangle, seen from the far corner, the weight along u belongs to the end of edge_v.
  const bool same_order = pb[(cb + 1) % 3] == pa[(ca + 2) % 3];
  for (std::size_t part = 0; part < 2; ++part) {
    const std::size_t corner = part == 0 ? ca : cb;
    const std::size_t along_u = (corner + (part == 0 || same_order ? 1 : 2)) % 3;
    const auto role = [&](std::size_t k) {
      return static_cast<std::uint8_t>(k == corner ? 0 : (k == along_u ? 1 : 2));
    };
    light.roles_[part] = {role(1), role(2)};
  }
  return light;
}

std::vector<AreaLight> AreaLight::group(std::span<const EmissiveTriangle> triangles) {
  std::vector<bool> free(triangles.size());
  for (std::size_t i = 0; i < triangles.size(); ++i) free[i] = shines(triangles[i]);
  const auto edges = shared_edges(triangles, free);
  std::vector<AreaLight> lights;
  for (const bool rectangles : {true, false}) {
    for (const SharedEdge& edge : edges) {
      if (!free[edge.a] || !free[edge.b]) continue;
      const auto merged = pair(triangles, edge);
      if (!merged || (rectangles && !merged->rectangle_)) continue;
      free[edge.a] = free[edge.b] = false;
      lights.push_back(*merged);
    }
  }
  for (std::uint32_t i = 0; i < triangles.size(); ++i) {
    if (free[i]) lights.emplace_back(triangles[i], i);
  }
  std::sort(lights.begin(), lights.end(),
            [](const AreaLight& a, const AreaLight& b) { return a.triangles_[0] < b.triangles_[0]; });
  return lights;
}

Box3f AreaLight::box() const {
  Box3f bounds(origin_);
  bounds.extendBy(origin_ + edge_u_);
  bounds.extendBy(origin_ + edge_v_);
  if (count_ == 2) bounds.extendBy(origin_ + edge_u_ + edge_v_);
  return bounds;
}

bool AreaLight::faces(const Vec3f& p) const {
  const float height = dot(ng_, p - origin_);
  return two_sided_ ? height != 0.0f : height > 0.0f;
}

AreaLight::Point AreaLight::point_at(float s, float t) const {
  const bool second = count_ == 2 && s + t > 1.0f;
  const float along_u = choose(second, 1.0f - s, s);
  const float along_v = choose(second, 1.0f - t, t);
  const std::array<float, 3> weights = {1.0f - along_u - along_v, along_u, along_v};
  const Roles& roles = roles_[second];
  return {origin_ + edge_u_ * s + edge_v_ * t, triangles_[second], Vec2f(weights[roles.second], weights[roles.third])};
}

AreaLight::Point AreaLight::sample_uniform(const Vec2f& u) const {
  const Vec2f st = count_ == 2 ? u : sample_triangle(u);
  return point_at(st.x, st.y);
}

/// Solid angle from `p` where it is large enough to sample by it, else 0.
double AreaLight::large_solid_angle(const Vec3f& p) const {
  const float clearance = length(p - center_) - radius_;
  if (clearance > 0.0f && static_cast<double>(area_) < kLargeSolidAngle * clearance * clearance) return 0.0;
  const Vec3d o = relative(origin_, p), u(edge_u_), v(edge_v_);
  double total = triangle_solid_angle(o, o + u, o + v);
  if (count_ == 2) total += triangle_solid_angle(o + u + v, o + v, o + u);
  return total > kLargeSolidAngle ? total : 0.0;
}

Vec2f AreaLight::sample_solid_angle(const Vec3f& p, const Vec2f& u) const {
  const Vec3d o = relative(origin_, p), eu(edge_u_), ev(edge_v_);
  if (rectangle_) return SphericalRectangle(o, eu, ev).sample(u);
  if (count_ == 1) return meet_triangle(o, eu, ev, sample_spherical_triangle(o, o + eu, o + ev, u));
  // A slanted parallelogram: both halves by their share of the solid angle, the first number used on.
  const Vec3d far_corner = o + eu + ev;
  const double first = triangle_solid_angle(o, o + eu, o + ev);
  const double share = first / (first + triangle_solid_angle(far_corner, o + ev, o + eu));
  const double x = static_cast<double>(u.x);
  if (x < share) {
    const Vec2f inner(std::min(static_cast<float>(x / share), kOneMinusEpsilon), u.y);
    return meet_triangle(o, eu, ev, sample_spherical_triangle(o, o + eu, o + ev, inner));
  }
  const Vec2f inner(std::clamp(static_cast<float>((x - share) / (1.0 - share)), 0.0f, kOneMinusEpsilon), u.y);
  const Vec2f st = meet_triangle(far_corner, -eu, -ev, sample_spherical_triangle(far_corner, o + ev, o + eu, inner));
  return {1.0f - st.x, 1.0f - st.y};
}

std::optional<AreaLight::Sample> AreaLight::sample(const Vec3f& p, const Vec2f& u) const {
  if (!faces(p)) return std::nullopt;
  const double solid_angle = large_solid_angle(p);
  Vec2f st;
  if (solid_angle > 0.0) {
    st = sample_solid_angle(p, u);
  } else {
    st = count_ == 2 ? u : sample_triangle(u);
  }
  Sample result;
  result.point = point_at(st.x, st.y);
  const Vec3f d = result.point.position - p;
  const float distance2 = length2(d);
  if (!(distance2 > 0.0f) || !std::isfinite(distance2)) return std::nullopt;
  result.distance = std::sqrt(distance2);
  result.wi = d * (1.0f / result.distance);
  const float cosine = std::abs(dot(ng_, result.wi));
  if (!(cosine > 0.0f)) return std::nullopt;
  result.pdf_w = solid_angle > 0.0 ? static_cast<float>(1.0 / solid_angle) : distance2 / (cosine * area_);
  if (!std::isfinite(result.pdf_w)) return std::nullopt;
  return result;
}

float AreaLight::pdf_w(const Vec3f& p, const Vec3f& q) const {
  if (!faces(p)) return 0.0f;
  const double solid_angle = large_solid_angle(p);
  if (solid_angle > 0.0) return static_cast<float>(1.0 / solid_angle);
  const Vec3f d = q - p;
  const float distance2 = length2(d);
  const float cosine = std::abs(dot(ng_, d)) / std::sqrt(distance2);
  const float pdf = distance2 / (cosine * area_);
  return std::isfinite(pdf) ? pdf : 0.0f;
}

}  // namespace pf
