#include "worker/scene/tangents.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>

#include "common/math/frame.h"

namespace pf {
namespace {

/// Copies vertex `from` of every attribute to the end.
void duplicate_vertex(Mesh& mesh, std::size_t from) {
  mesh.positions.push_back(Vec3f(mesh.positions[from]));
  mesh.normals.push_back(Vec3f(mesh.normals[from]));
  mesh.tangents.push_back(Vec4f(mesh.tangents[from]));
  for (auto& set : mesh.uv) {
    if (!set.empty()) set.push_back(Vec2f(set[from]));
  }
  if (!mesh.colors.empty()) mesh.colors.push_back(Vec4f(mesh.colors[from]));
}

template <typename T>
std::vector<T> gathered(const std::vector<T>& values, const std::vector<std::uint32_t>& order) {
  std::vector<T> out;
  if (values.empty()) return out;
  out.reserve(order.size());
  for (const std::uint32_t i : order) out.push_back(values[i]);
  return out;
}

/// For each vertex, the first vertex with the same position, normal and uv, bit for bit.
std::vector<std::uint32_t> welded(const Mesh& mesh, const std::vector<Vec2f>& uv) {
  using Key = std::array<float, 8>;
  const auto key = [&](std::uint32_t i) {
    const Vec3f& p = mesh.positions[i];
    const Vec3f& n = mesh.normals[i];
    return Key{p.x, p.y, p.z, n.x, n.y, n.z, uv[i].x, uv[i].y};
  };
  std::vector<std::uint32_t> order(mesh.positions.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const Key ka = key(a);
    const Key kb = key(b);
    return ka != kb ? ka < kb : a < b;
  });
  std::vector<std::uint32_t> out(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) {
    const bool same = k > 0 && key(order[k]) == key(order[k - 1]);
    out[order[k]] = same ? out[order[k - 1]] : order[k];
  }
  return out;
}

/// Direction of growing u on a triangle, and how the triangle lies in uv.
struct FaceTangent {
  Vec3f direction{0.0f, 0.0f, 0.0f};
  int mirrored = 0;    ///< index 0 or 1
  bool valid = false;  ///< false: no area in uv
};

FaceTangent face_tangent(const Vec3f& e1, const Vec3f& e2, Vec2f d1, Vec2f d2) {
  d1.y = -d1.y;  // v upwards
  d2.y = -d2.y;
  const float area = d1.x * d2.y - d1.y * d2.x;
  FaceTangent out;
  if (!(std::abs(area) > 0.0f)) return out;
  const Vec3f t = (e1 * d2.y - e2 * d1.y) * (area > 0.0f ? 1.0f : -1.0f);
  out.direction = unit_or_zero(t);
  if (is_zero(out.direction)) return out;
  out.mirrored = area > 0.0f ? 0 : 1;
  out.valid = true;
  return out;
}

Vec3f projected(const Vec3f& v, const Vec3f& n) {
  // Twice: what is left of a vector nearly along n is mostly rounding.
  const Vec3f p = unit_or_zero(v - n * dot(n, v));
  return unit_or_zero(p - n * dot(n, p));
}

float angle_between(const Vec3f& a, const Vec3f& b) { return std::acos(std::clamp(dot(a, b), -1.0f, 1.0f)); }

}  // namespace

Vec3f unit_or_zero(const Vec3f& v) {
  const double x = v.x, y = v.y, z = v.z;
  const double l = std::sqrt(x * x + y * y + z * z);
  if (!(l > 0.0) || !std::isfinite(l)) return {0.0f, 0.0f, 0.0f};
  return {static_cast<float>(x / l), static_cast<float>(y / l), static_cast<float>(z / l)};
}

Vec4f any_tangent(const Vec3f& normal) {
  const Vec3f t = Frame::from_normal(normal).t;
  return {t.x, t.y, t.z, 1.0f};
}

void make_flat(Mesh& mesh) {
  std::vector<std::uint32_t> order;
  order.reserve(mesh.triangles.size() * 3);
  for (const auto& t : mesh.triangles) order.insert(order.end(), t.begin(), t.end());
  mesh.positions = gathered(mesh.positions, order);
  mesh.colors = gathered(mesh.colors, order);
  for (auto& set : mesh.uv) set = gathered(set, order);
  mesh.tangents.clear();
  mesh.normals.clear();
  for (std::uint32_t i = 0; i < mesh.triangles.size(); ++i) {
    mesh.triangles[i] = {3 * i, 3 * i + 1, 3 * i + 2};
    const Vec3f& p = mesh.positions[3 * i];
    const Vec3f n = unit_or_zero(cross(mesh.positions[3 * i + 1] - p, mesh.positions[3 * i + 2] - p));
    mesh.normals.insert(mesh.normals.end(), 3, n);
  }
}

void generate_tangents(Mesh& mesh, const std::vector<Vec2f>& uv) {
  const std::size_t vertices = mesh.positions.size();
  const std::vector<std::uint32_t> weld = welded(mesh, uv);
  std::vector<FaceTangent> faces;
  faces.reserve(mesh.triangles.size());

  // Sum the triangles' tangents per welded vertex and orientation.
  std::vector<std::array<Vec3f, 2>> sums(vertices, {Vec3f(0.0f, 0.0f, 0.0f), Vec3f(0.0f, 0.0f, 0.0f)});
  for (const auto& t : mesh.triangles) {
    const Vec3f& p0 = mesh.positions[t[0]];
    faces.push_back(
        face_tangent(mesh.positions[t[1]] - p0, mesh.positions[t[2]] - p0, uv[t[1]] - uv[t[0]], uv[t[2]] - uv[t[0]]));
    const FaceTangent& face = faces.back();
    if (!face.valid) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::uint32_t i = t[c];
      const Vec3f& n = mesh.normals[i];
      const Vec3f a = projected(mesh.positions[t[(c + 1) % 3]] - mesh.positions[i], n);
      const Vec3f b = projected(mesh.positions[t[(c + 2) % 3]] - mesh.positions[i], n);
      sums[weld[i]][static_cast<std::size_t>(face.mirrored)] += projected(face.direction, n) * angle_between(a, b);
    }
  }

  // The first orientation that a vertex meets is its own; the other one, where it occurs, gets a copy.
  constexpr std::uint32_t kNone = 0xffffffffu;
  std::vector<std::array<std::uint32_t, 2>> vertex_of(vertices, {kNone, kNone});
  mesh.tangents.assign(vertices, Vec4f(0.0f, 0.0f, 0.0f, 0.0f));
  const auto place = [&](std::uint32_t i, int mirrored) {
    std::uint32_t& vertex = vertex_of[i][static_cast<std::size_t>(mirrored)];
    if (vertex != kNone) return vertex;
    if (vertex_of[i][static_cast<std::size_t>(1 - mirrored)] == kNone) {
      vertex = i;
    } else {
      vertex = static_cast<std::uint32_t>(mesh.positions.size());
      duplicate_vertex(mesh, i);
    }
    const Vec3f t = projected(sums[weld[i]][static_cast<std::size_t>(mirrored)], mesh.normals[i]);
    mesh.tangents[vertex] =
        is_zero(t) ? any_tangent(mesh.normals[i]) : Vec4f(t.x, t.y, t.z, mirrored == 0 ? 1.0f : -1.0f);
    return vertex;
  };
  for (std::size_t f = 0; f < mesh.triangles.size(); ++f) {
    if (!faces[f].valid) continue;
    for (std::uint32_t& i : mesh.triangles[f]) i = place(i, faces[f].mirrored);
  }
  // Triangles without area in uv take the frames of their neighbours, or any.
  for (std::size_t f = 0; f < mesh.triangles.size(); ++f) {
    if (faces[f].valid) continue;
    for (std::uint32_t& i : mesh.triangles[f]) {
      const int mirrored = is_zero(sums[weld[i]][0]) && !is_zero(sums[weld[i]][1]) ? 1 : 0;
      i = place(i, mirrored);
    }
  }
  for (std::size_t i = 0; i < vertices; ++i) {
    if (vertex_of[i][0] == kNone && vertex_of[i][1] == kNone) mesh.tangents[i] = any_tangent(mesh.normals[i]);
  }
}

}  // namespace pf
