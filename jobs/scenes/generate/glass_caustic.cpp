// A wine glass, a bottle of amber liquid and two marbles on a table that bends up into a backdrop. A small
// lamp behind them throws caustics towards the camera; a large dim panel in front gives the glass something
// to reflect. All in metres.

#include <cmath>

#include "jobs/scenes/generate/gltf.h"
#include "jobs/scenes/generate/profile.h"
#include "jobs/scenes/generate/scenes.h"

namespace pf::scenes {
namespace {

constexpr int kSegments = 96;
constexpr double kLift = 2e-4;     // air between glass and table: two surfaces never coincide
constexpr double kOverlap = 1e-4;  // by which a liquid reaches into its glass

struct Vessel {
  Profile glass;
  std::size_t inner;  // first sample of the inner wall; it runs down to the axis
  [[nodiscard]] std::vector<Profile::Sample> inner_wall() const {
    return {glass.samples().begin() + static_cast<std::ptrdiff_t>(inner), glass.samples().end()};
  }
};

Vessel wine_glass() {
  const double wall = 0.0015;
  Profile p({0, 0});
  p.line_to({0.0325, 0});
  p.arc({0.0325, 0.0012}, 180, 8);                                       // edge of the foot
  p.curve_to({0.0110, 0.0024}, {0.0040, 0.0060}, {0.0040, 0.0220}, 14);  // foot into stem
  p.line_to({0.0040, 0.0680}, 3);
  p.curve_to({0.0040, 0.0790}, {0.0205, 0.0845}, {0.0300, 0.0940}, 12);  // stem into bowl
  const std::size_t bowl = p.samples().size() - 1;
  p.curve_to({0.0360, 0.1000}, {0.0400, 0.1110}, {0.0400, 0.1270}, 14);
  p.curve_to({0.0400, 0.1500}, {0.0345, 0.1780}, {0.0320, 0.1980}, 22);
  const std::size_t rim = p.samples().size() - 1;
  p.arc(p.pen() - p.samples()[rim].normal * (0.5 * wall), 180, 8);
  const std::size_t inner = p.samples().size() - 1;
  p.parallel_back(bowl, rim, wall);
  const Vec2 q = p.pen();
  const double k = 0.0055;
  p.curve_to({q.x - k, q.y - k * 0.0095 / 0.0095}, {0.0130, 0.0865}, {0.0, 0.0865},
             16);  // bottom of the bowl
  return {p, inner};
}

Vessel bottle() {
  Profile p({0, 0.0040});
  p.curve_to({0.0100, 0.0040}, {0.0180, 0}, {0.0240, 0}, 8);  // hollow of the base
  p.line_to({0.0310, 0});
  p.arc({0.0310, 0.0050}, 90, 8);
  p.line_to({0.0360, 0.1500}, 4);
  p.curve_to({0.0360, 0.1900}, {0.0135, 0.1850}, {0.0135, 0.2200}, 22);  // shoulder
  p.line_to({0.0135, 0.2520}, 2);
  p.curve_to({0.0135, 0.2550}, {0.0158, 0.2540}, {0.0158, 0.2580}, 6);  // lip
  p.line_to({0.0158, 0.2630});
  p.arc({0.0134, 0.2630}, 180, 10);
  const std::size_t inner = p.samples().size() - 1;
  p.line_to({0.0110, 0.2200}, 3);
  p.curve_to({0.0110, 0.1870}, {0.0338, 0.1890}, {0.0338, 0.1500}, 22);
  p.line_to({0.0338, 0.0120}, 12);
  p.arc({0.0288, 0.0120}, -90, 8);
  p.curve_to({0.0180, 0.0070}, {0.0100, 0.0100}, {0, 0.0100}, 8);
  return {p, inner};
}

Profile cork() {
  Profile p({0, 0.2480});
  p.line_to({0.0112, 0.2480});  // 0.2 mm into the neck
  p.line_to({0.0112, 0.2790});
  p.arc({0.0102, 0.2790}, 90, 5);
  p.line_to({0, 0.2800});
  return p;
}

Mesh moved(Mesh mesh, const Vec3& offset) {
  for (Vec3& p : mesh.positions) p += offset;
  return mesh;
}

/// Table and wall as one sheet with a quarter circle between them.
Mesh backdrop() {
  const double half = 1.4, front = 0.9, back = -0.45, bend = 0.35, top = 1.3;
  Mesh mesh;
  const auto row = [&](double y, double z, double ny, double nz) {
    for (const double x : {-half, half}) {
      mesh.positions.emplace_back(x, y, z);
      mesh.normals.emplace_back(0.0, ny, nz);
    }
    const auto i = static_cast<std::uint32_t>(mesh.positions.size());
    if (i < 4) return;
    mesh.triangles.push_back({i - 4, i - 3, i - 1});
    mesh.triangles.push_back({i - 4, i - 1, i - 2});
  };
  row(0, front, 1, 0);
  constexpr int kSteps = 32;
  for (int i = 0; i <= kSteps; ++i) {
    const double phi = radians(90.0 * i / kSteps), s = std::sin(phi), c = std::cos(phi);
    row(bend * (1 - c), back - bend * s, c, s);
  }
  row(top, back - bend, 0, 1);
  return mesh;
}

}  // namespace

std::string make_glass_caustic() {
  const Material glass = dielectric("glass", 1.5, 0.002);
  const Vec3 wine_at(0.062, kLift, 0.005), bottle_at(-0.068, kLift, -0.060);
  const Vessel wine = wine_glass(), flask = bottle();
  GltfBuilder scene;
  scene.add("backdrop", backdrop(), lambert("backdrop", Vec3(0.60, 0.57, 0.53)));
  scene.add("wine glass", moved(lathe(wine.glass, kSegments), wine_at), glass);
  scene.add("wine", moved(lathe(liquid_in(wine.inner_wall(), 0.1290, kOverlap, 0.001), kSegments), wine_at),
            dielectric("wine", 1.345, 0.05, Vec3(0.72, 0.06, 0.10), 0.03));
  scene.add("bottle", moved(lathe(flask.glass, kSegments), bottle_at), glass);
  scene.add("liquor", moved(lathe(liquid_in(flask.inner_wall(), 0.1300, kOverlap, 0.001), kSegments), bottle_at),
            dielectric("liquor", 1.36, 0.06, Vec3(0.90, 0.42, 0.05), 0.03));
  scene.add("cork", moved(lathe(cork(), 48), bottle_at), lambert("cork", Vec3(0.45, 0.29, 0.16)));
  scene.add_sphere("blue marble", {-0.035, 0.014 + kLift, 0.060}, 0.014, 4,
                   dielectric("blue glass", 1.52, 0.028, Vec3(0.15, 0.45, 0.90), 0.02));
  scene.add_sphere("clear marble", {-0.005, 0.010 + kLift, 0.088}, 0.010, 4, dielectric("clear glass", 1.52, 0.020));
  const Vec3 lamp(0.15, 0.41, -0.38), aim(0.0, 0.08, 0.0);
  scene.add("lamp", disc(lamp, (aim - lamp).normalized(), 0.006, 48), emitter("lamp", Vec3(11000, 10000, 8300)));
  scene.add("panel", panel({0.75, 0.60, 0.35}, {0, 0.1, 0}, 0.7, 0.6), emitter("panel", Vec3(1.7, 1.8, 2.0)));
  scene.set_camera({0.02, 0.375, 0.73}, {-0.004, 0.113, 0.0}, 0.50, 4.0 / 3.0);
  return scene.pack();
}

}  // namespace pf::scenes
