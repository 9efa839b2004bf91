// The box on which photonfarm is compared with other renderers: an open box with a mirror and a glass sphere.

#include "jobs/scenes/generate/gltf.h"
#include "jobs/scenes/generate/scenes.h"

namespace pf::scenes {

std::string make_peer_box() {
  const Material white = lambert("white", Vec3(0.73));
  const Material red = lambert("red", Vec3(0.63, 0.065, 0.05));
  const Material green = lambert("green", Vec3(0.14, 0.45, 0.091));
  const double a = 0.5, l = 0.125, y = 0.998;
  constexpr int kSubdivisions = 6;  // 81,920 triangles: the sphere's outline is off by 1e-4 of its radius
  GltfBuilder scene;
  scene.add("floor", quad({-a, 0, a}, {a, 0, a}, {a, 0, -a}, {-a, 0, -a}), white);
  scene.add("ceiling", quad({-a, 1, -a}, {a, 1, -a}, {a, 1, a}, {-a, 1, a}), white);
  scene.add("back", quad({-a, 0, -a}, {a, 0, -a}, {a, 1, -a}, {-a, 1, -a}), white);
  scene.add("left", quad({-a, 0, a}, {-a, 0, -a}, {-a, 1, -a}, {-a, 1, a}), red);
  scene.add("right", quad({a, 0, -a}, {a, 0, a}, {a, 1, a}, {a, 1, -a}), green);
  scene.add("light", quad({-l, y, -l}, {l, y, -l}, {l, y, l}, {-l, y, l}), emitter("light", Vec3(16.0)));
  scene.add_sphere("mirror", {-0.22, 0.20, -0.18}, 0.20, kSubdivisions, metal("mirror", Vec3(1.0), 0.0));
  scene.add_sphere("glass", {0.22, 0.18, 0.12}, 0.18, kSubdivisions, dielectric("glass", 1.5, 0.36));
  scene.set_camera({0, 0.5, 1.9}, {0, 0.5, 0}, 0.6806784082777885, 1.0);  // 39 degrees
  return scene.pack();
}

}  // namespace pf::scenes
