// A tiled pool under the sun. The water is a closed volume: its top a sum of sine waves with exact normals,
// its sides and its bottom one centimetre behind the tiles, so that the water ends where the wall begins and
// no film of air is left.

#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "jobs/scenes/generate/gltf.h"
#include "jobs/scenes/generate/scenes.h"

namespace pf::scenes {
namespace {

constexpr double kHalfX = 2.0, kHalfZ = 1.5, kDepth = 1.1, kDeck = 0.10, kDeckWidth = 1.2, kHidden = 0.01;

struct Wave {
  double amplitude, length;  // metres
  double degrees, phase;     // heading from +x towards +z; radians
};
// A long swell and shorter ripples on it. Crests focus at about 4 / (amplitude k^2) below the surface (n / (n
// - 1) radii of curvature): these lie around the pool's depth.
constexpr std::array<Wave, 9> kWaves{{{0.0140, 1.45, 12, 0.3},
                                      {0.0110, 1.10, 71, 2.1},
                                      {0.0085, 0.83, -38, 4.4},
                                      {0.0060, 0.61, 127, 1.2},
                                      {0.0046, 0.49, 24, 5.3},
                                      {0.0036, 0.42, -81, 0.9},
                                      {0.0026, 0.35, 96, 3.6},
                                      {0.0020, 0.29, -12, 2.8},
                                      {0.0015, 0.25, 53, 5.9}}};

void add_water_point(Mesh& mesh, double x, double z) {
  double y = 0, dx = 0, dz = 0;
  for (const Wave& w : kWaves) {
    const double k = 2.0 * std::numbers::pi / w.length;
    const double kx = k * std::cos(radians(w.degrees)), kz = k * std::sin(radians(w.degrees));
    const double phase = kx * x + kz * z + w.phase;
    y += w.amplitude * std::sin(phase);
    dx += w.amplitude * kx * std::cos(phase);
    dz += w.amplitude * kz * std::cos(phase);
  }
  mesh.positions.emplace_back(x, y, z);
  mesh.normals.push_back(Vec3(-dx, 1, -dz).normalized());
}

Mesh water() {
  constexpr std::uint32_t nx = 168, nz = 126;
  const double half_x = kHalfX + kHidden, half_z = kHalfZ + kHidden, bottom = -kDepth - kHidden;
  Mesh mesh;
  for (std::uint32_t j = 0; j <= nz; ++j) {
    for (std::uint32_t i = 0; i <= nx; ++i)
      add_water_point(mesh, half_x * (2.0 * i / nx - 1), half_z * (2.0 * j / nz - 1));
  }
  const auto at = [&](std::uint32_t i, std::uint32_t j) { return j * (nx + 1) + i; };
  for (std::uint32_t j = 0; j < nz; ++j) {
    for (std::uint32_t i = 0; i < nx; ++i) {
      mesh.triangles.push_back({at(i, j), at(i, j + 1), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i + 1, j)});
    }
  }
  std::vector<std::uint32_t> rim;  // counter-clockwise seen from above
  for (std::uint32_t j = 0; j < nz; ++j) rim.push_back(at(0, j));
  for (std::uint32_t i = 0; i < nx; ++i) rim.push_back(at(i, nz));
  for (std::uint32_t j = nz; j > 0; --j) rim.push_back(at(nx, j));
  for (std::uint32_t i = nx; i > 0; --i) rim.push_back(at(i, 0));
  const auto add = [&](const Vec3& p, const Vec3& n) {
    mesh.positions.push_back(p);
    mesh.normals.push_back(n);
    return static_cast<std::uint32_t>(mesh.positions.size() - 1);
  };
  const std::uint32_t middle = add({0, bottom, 0}, {0, -1, 0});
  for (std::size_t r = 0; r < rim.size(); ++r) {
    const Vec3 a = mesh.positions[rim[r]], b = mesh.positions[rim[(r + 1) % rim.size()]];
    const Vec3 a0(a.x, bottom, a.z), b0(b.x, bottom, b.z);
    const Vec3 side = Vec3(0, 1, 0).cross(a0 - b0).normalized();
    const std::uint32_t first = add(a, side);
    add(a0, side), add(b0, side), add(b, side);
    mesh.triangles.push_back({first, first + 1, first + 2});
    mesh.triangles.push_back({first, first + 2, first + 3});
    const std::uint32_t below = add(a0, {0, -1, 0});
    add(b0, {0, -1, 0});
    mesh.triangles.push_back({middle, below + 1, below});
  }
  return mesh;
}

/// Square tiles and the joints between them on the rectangle corner + s u + t v, with s in [0, nu], t in [0,
/// nv] tiles; u x v is the front. `trim` tile rows before the end of v are dark.
void append_tiles(Mesh& mesh, std::minstd_rand& random, const Vec3& corner, const Vec3& u, int nu, const Vec3& v,
                  int nv, int trim) {
  constexpr double kJoint = 0.03;  // half of a joint, in tiles
  const auto cut = [](int i) {
    const int tile = i / 2;
    return tile + ((i & 1) ? kJoint : (i == 0 ? 0.0 : -kJoint));
  };
  const auto at = [&](int i, int n) { return i == 2 * n + 1 ? n : cut(i); };
  for (int j = 0; j <= 2 * nv; ++j) {
    for (int i = 0; i <= 2 * nu; ++i) {
      const double s0 = at(i, nu), s1 = at(i + 1, nu), t0 = at(j, nv), t1 = at(j + 1, nv);
      append_quad(mesh, corner + u * s0 + v * t0, corner + u * s1 + v * t0, corner + u * s1 + v * t1,
                  corner + u * s0 + v * t1);
      Vec3 color(0.78, 0.80, 0.80);
      if ((i & 1) && (j & 1)) {
        const double shade = 0.90 + 0.10 * static_cast<double>(random() % 1024) / 1023.0;
        color = (j / 2 >= nv - trim ? Vec3(0.10, 0.28, 0.50) : Vec3(0.42, 0.64, 0.68)) * shade;
      }
      mesh.colors.insert(mesh.colors.end(), 4, color);
    }
  }
}

Mesh tiles() {
  constexpr double t = 0.2;
  constexpr int nx = 20, nz = 15, ny = 6;  // 4 m, 3 m, 1.2 m of 20 cm tiles
  const double x = kHalfX, z = kHalfZ, y = -kDepth;
  std::minstd_rand random(7);
  Mesh mesh;
  append_tiles(mesh, random, {-x, y, z}, {t, 0, 0}, nx, {0, 0, -t}, nz, 0);
  append_tiles(mesh, random, {-x, y, -z}, {t, 0, 0}, nx, {0, t, 0}, ny, 1);
  append_tiles(mesh, random, {x, y, z}, {-t, 0, 0}, nx, {0, t, 0}, ny, 1);
  append_tiles(mesh, random, {-x, y, z}, {0, 0, -t}, nz, {0, t, 0}, ny, 1);
  append_tiles(mesh, random, {x, y, -z}, {0, 0, t}, nz, {0, t, 0}, ny, 1);
  return mesh;
}

Mesh deck() {
  const double x = kHalfX, z = kHalfZ, X = x + kDeckWidth, Z = z + kDeckWidth, y = kDeck;
  Mesh mesh;
  append_quad(mesh, {-X, y, Z}, {X, y, Z}, {X, y, z}, {-X, y, z});
  append_quad(mesh, {-X, y, -z}, {X, y, -z}, {X, y, -Z}, {-X, y, -Z});
  append_quad(mesh, {-X, y, z}, {-x, y, z}, {-x, y, -z}, {-X, y, -z});
  append_quad(mesh, {x, y, z}, {X, y, z}, {X, y, -z}, {x, y, -z});
  return mesh;
}

}  // namespace

std::string make_pool() {
  GltfBuilder scene;
  scene.add("tiles", tiles(), lambert("tiles", Vec3(1.0)));
  scene.add("deck", deck(), lambert("stone", Vec3(0.60, 0.55, 0.48)));
  scene.add("water", water(), dielectric("water", 1.33, kDepth, Vec3(0.55, 0.88, 0.94), 2.5));
  scene.add_sphere("ball", {0.85, 0.06, 0.15}, 0.17, 4, lambert("ball", Vec3(0.75, 0.12, 0.06)));
  scene.add_directional_light("sun", {0.35, -1.0, -0.25}, Vec3(3.4, 3.2, 2.8));
  scene.set_camera({-0.35, 2.65, 2.65}, {0.03, -0.60, -0.12}, 0.68, 16.0 / 9.0);
  return scene.pack();
}

}  // namespace pf::scenes
