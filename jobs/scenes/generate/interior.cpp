// A room that is lit through one narrow window by a panel outside: a patch of direct light on the floor,
// everything else indirect. Few photons find the window, which is what projection maps are for.

#include "jobs/scenes/generate/gltf.h"
#include "jobs/scenes/generate/scenes.h"

namespace pf::scenes {
namespace {

constexpr double kX = 2.0, kY = 2.6, kZ = 2.5;  // the room: |x| < kX, 0 < y < kY, |z| < kZ
constexpr double kOver = 0.02;                  // walls run past each other: no light between them
constexpr double kWindowLow = 0.9, kWindowHigh = 2.1, kWindowBack = -1.3, kWindowFront = -0.75, kWall = 0.18;

Mesh white_walls() {
  const double x = kX + kOver, y0 = -kOver, y1 = kY + kOver, z = kZ + kOver;
  Mesh mesh;
  append_quad(mesh, {-x, kY, -z}, {x, kY, -z}, {x, kY, z}, {-x, kY, z});        // ceiling
  append_quad(mesh, {-x, y0, -kZ}, {x, y0, -kZ}, {x, y1, -kZ}, {-x, y1, -kZ});  // back
  append_quad(mesh, {x, y0, kZ}, {-x, y0, kZ}, {-x, y1, kZ}, {x, y1, kZ});      // behind the camera
  return mesh;
}

/// The wall at x = -kX, with the window's opening and its reveal through the wall.
Mesh window_wall() {
  const double x = -kX, out = -kX - kWall, y0 = -kOver, y1 = kY + kOver, z = kZ + kOver;
  const double l = kWindowLow, h = kWindowHigh, b = kWindowBack, f = kWindowFront;
  Mesh mesh;
  append_quad(mesh, {x, y0, z}, {x, y0, -z}, {x, l, -z}, {x, l, z});
  append_quad(mesh, {x, h, z}, {x, h, -z}, {x, y1, -z}, {x, y1, z});
  append_quad(mesh, {x, l, b}, {x, l, -z}, {x, h, -z}, {x, h, b});
  append_quad(mesh, {x, l, z}, {x, l, f}, {x, h, f}, {x, h, z});
  append_quad(mesh, {out, l, f}, {x, l, f}, {x, l, b}, {out, l, b});  // sill
  append_quad(mesh, {out, h, b}, {x, h, b}, {x, h, f}, {out, h, f});  // lintel
  append_quad(mesh, {out, l, b}, {x, l, b}, {x, h, b}, {out, h, b});
  append_quad(mesh, {x, l, f}, {out, l, f}, {out, h, f}, {x, h, f});
  return mesh;
}

Mesh table() {
  Mesh mesh;
  append_box(mesh, {0.10, 0.70, -1.55}, {1.40, 0.74, -0.75});
  for (const double x : {0.16, 1.28}) {
    for (const double z : {-1.49, -0.87}) append_box(mesh, {x, -0.01, z}, {x + 0.06, 0.705, z + 0.06});
  }
  return mesh;
}

Mesh shelf() {
  Mesh mesh;
  for (const double x : {-1.70, -0.62}) append_box(mesh, {x, -0.01, -2.51}, {x + 0.03, 1.75, -2.15});
  for (const double y : {0.05, 0.60, 1.15, 1.72}) append_box(mesh, {-1.68, y, -2.51}, {-0.60, y + 0.03, -2.151});
  return mesh;
}

Mesh books() {
  Mesh mesh;
  double x = -1.64;
  for (const double width : {0.05, 0.04, 0.06, 0.03, 0.05, 0.07, 0.04}) {
    append_box(mesh, {x, 0.629, -2.45}, {x + width, 0.86 + 2.0 * width, -2.22});
    x += width + 0.004;
  }
  append_box(mesh, {-1.15, 1.179, -2.45}, {-0.85, 1.42, -2.20}, 12);
  append_box(mesh, {-1.45, 0.079, -2.45}, {-0.95, 0.40, -2.20});
  return mesh;
}

Mesh sofa() {
  Mesh mesh;
  append_box(mesh, {1.10, -0.01, -0.20}, {2.01, 0.42, 1.40});
  append_box(mesh, {1.75, 0.41, -0.20}, {2.01, 0.85, 1.40});
  append_box(mesh, {1.10, 0.41, -0.20}, {1.76, 0.60, -0.02});
  return mesh;
}

/// A black box around the panel: its light can leave through the window alone, and lights no wall from
/// behind.
Mesh shaft() {
  const double near = -kX - kWall, far = -4.3, y0 = 0.2, y1 = 4.2, z0 = -2.4, z1 = 0.4, o = kOver;
  const double l = kWindowLow, h = kWindowHigh, b = kWindowBack, f = kWindowFront;
  Mesh mesh;
  append_quad(mesh, {far, y0 - o, z1 + o}, {far, y0 - o, z0 - o}, {far, y1 + o, z0 - o}, {far, y1 + o, z1 + o});
  append_quad(mesh, {far - o, y0, z1 + o}, {near + o, y0, z1 + o}, {near + o, y0, z0 - o}, {far - o, y0, z0 - o});
  append_quad(mesh, {far - o, y1, z0 - o}, {near + o, y1, z0 - o}, {near + o, y1, z1 + o}, {far - o, y1, z1 + o});
  append_quad(mesh, {far - o, y0 - o, z0}, {near + o, y0 - o, z0}, {near + o, y1 + o, z0}, {far - o, y1 + o, z0});
  append_quad(mesh, {near + o, y0 - o, z1}, {far - o, y0 - o, z1}, {far - o, y1 + o, z1}, {near + o, y1 + o, z1});
  append_quad(mesh, {near, y0 - o, z0 - o}, {near, y0 - o, z1 + o}, {near, l, z1 + o}, {near, l, z0 - o});
  append_quad(mesh, {near, h, z0 - o}, {near, h, z1 + o}, {near, y1 + o, z1 + o}, {near, y1 + o, z0 - o});
  append_quad(mesh, {near, l, z0 - o}, {near, l, b}, {near, h, b}, {near, h, z0 - o});
  append_quad(mesh, {near, l, f}, {near, l, z1 + o}, {near, h, z1 + o}, {near, h, f});
  return mesh;
}

}  // namespace

std::string make_interior() {
  const double x = kX + kOver, z = kZ + kOver, y1 = kY + kOver;
  const Material white = lambert("plaster", Vec3(0.78, 0.76, 0.72));
  GltfBuilder scene;
  scene.add("walls", white_walls(), white);
  scene.add("window wall", window_wall(), white);
  scene.add("right wall", quad({kX, -kOver, -z}, {kX, -kOver, z}, {kX, y1, z}, {kX, y1, -z}),
            lambert("ochre", Vec3(0.68, 0.44, 0.20)));
  scene.add("floor", quad({-x, 0, z}, {x, 0, z}, {x, 0, -z}, {-x, 0, -z}), lambert("boards", Vec3(0.52, 0.36, 0.23)));
  scene.add("table", table(), lambert("oak", Vec3(0.50, 0.33, 0.18)));
  scene.add("shelf", shelf(), lambert("painted wood", Vec3(0.70, 0.70, 0.68)));
  scene.add("books", books(), lambert("linen", Vec3(0.30, 0.12, 0.10)));
  scene.add("sofa", sofa(), lambert("cloth", Vec3(0.16, 0.28, 0.42)));
  scene.add("box", box({-0.45, -0.01, 0.10}, {0.05, 0.38, 0.60}, 25), lambert("green", Vec3(0.22, 0.45, 0.20)));
  scene.add_sphere("globe", {0.62, 0.739 + 0.17, -1.15}, 0.17, 4, lambert("globe", Vec3(0.75, 0.70, 0.60)));
  scene.add("shaft", shaft(), lambert("black", Vec3(0.0)));
  scene.add("sky panel", panel({-3.5, 3.3, -1.0}, {-1.9, 1.4, -1.0}, 1.1, 1.1),
            emitter("sky panel", Vec3(520, 490, 430)));
  scene.set_camera({0.75, 1.45, 2.40}, {-0.10, 0.95, -1.0}, 0.95, 4.0 / 3.0);
  return scene.pack();
}

}  // namespace pf::scenes
