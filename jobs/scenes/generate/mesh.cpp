#include "jobs/scenes/generate/mesh.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

namespace pf::scenes {

double radians(double degrees) { return degrees * (std::numbers::pi / 180.0); }

void append_quad(Mesh& mesh, const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), {a, b, c, d});
  mesh.triangles.push_back({first, first + 1, first + 2});
  mesh.triangles.push_back({first, first + 2, first + 3});
}

Mesh quad(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  Mesh mesh;
  append_quad(mesh, a, b, c, d);
  return mesh;
}

Mesh panel(const Vec3& centre, const Vec3& target, double width, double height) {
  const Vec3 normal = (target - centre).normalized();
  const Vec3 u = Vec3(0, 1, 0).cross(normal).normalized() * (0.5 * width);
  const Vec3 v = normal.cross(u).normalized() * (0.5 * height);
  return quad(centre - u - v, centre + u - v, centre + u + v, centre - u + v);
}

void append_box(Mesh& mesh, const Vec3& low, const Vec3& high, double degrees) {
  const Vec3 middle = (low + high) * 0.5;
  const double c = std::cos(radians(degrees));
  const double s = std::sin(radians(degrees));
  const auto corner = [&](int i) {
    const Vec3 p((i & 1) ? high.x : low.x, (i & 2) ? high.y : low.y, (i & 4) ? high.z : low.z);
    if (degrees == 0.0) return p;
    const Vec3 d = p - middle;
    return Vec3(middle.x + c * d.x + s * d.z, p.y, middle.z - s * d.x + c * d.z);
  };
  static constexpr int kFaces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                       {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  for (const auto& f : kFaces) append_quad(mesh, corner(f[0]), corner(f[1]), corner(f[2]), corner(f[3]));
}

Mesh box(const Vec3& low, const Vec3& high, double degrees) {
  Mesh mesh;
  append_box(mesh, low, high, degrees);
  return mesh;
}

Mesh disc(const Vec3& centre, const Vec3& normal, double radius, int segments) {
  const Vec3 helper = std::abs(normal.y) < 0.9 ? Vec3(0, 1, 0) : Vec3(1, 0, 0);
  const Vec3 u = helper.cross(normal).normalized();
  const Vec3 v = normal.cross(u);
  Mesh mesh;
  mesh.positions.push_back(centre);
  const auto n = static_cast<std::uint32_t>(segments);
  for (std::uint32_t i = 0; i < n; ++i) {
    const double phi = 2.0 * std::numbers::pi * i / segments;
    mesh.positions.push_back(centre + (u * std::cos(phi) + v * std::sin(phi)) * radius);
    mesh.triangles.push_back({0, i + 1, (i + 1) % n + 1});
  }
  return mesh;
}

Mesh icosphere(int subdivisions) {
  const double g = std::numbers::phi;
  Mesh mesh;
  mesh.positions = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                    {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  for (Vec3& p : mesh.positions) p.normalize();
  mesh.triangles = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                    {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                    {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (int level = 0; level < subdivisions; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> halves;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [it, fresh] = halves.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(mesh.positions.size()));
      if (fresh) mesh.positions.push_back((mesh.positions[a] + mesh.positions[b]).normalized());
      return it->second;
    };
    std::vector<std::array<std::uint32_t, 3>> finer;
    finer.reserve(mesh.triangles.size() * 4);
    for (const auto& [a, b, c] : mesh.triangles) {
      const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    mesh.triangles = std::move(finer);
  }
  mesh.normals = mesh.positions;
  return mesh;
}

}  // namespace pf::scenes
