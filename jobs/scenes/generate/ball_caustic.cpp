// Parallel light through a glass ball onto a floor two radii below its centre: half a radius behind the
// paraxial focus at nR / (2 (n - 1)) = 1.5 R, where the irradiance has a closed form (geometric optics of a
// ball lens).

#include "jobs/scenes/generate/gltf.h"
#include "jobs/scenes/generate/scenes.h"

namespace pf::scenes {

std::string make_ball_caustic() {
  const double radius = 0.1, floor = 0.3;
  GltfBuilder scene;
  scene.add("floor", quad({-floor, 0, floor}, {floor, 0, floor}, {floor, 0, -floor}, {-floor, 0, -floor}),
            lambert("floor", Vec3(0.5)));
  scene.add_sphere("ball", {0, 2.0 * radius, 0}, radius, 6, dielectric("glass", 1.5, 2.0 * radius));
  scene.add_directional_light("sun", {0, -1, 0}, Vec3(3.14159265));
  scene.set_camera({0, 0.55, 0.75}, {0, 0.09, 0}, 0.62, 4.0 / 3.0);
  return scene.pack();
}

}  // namespace pf::scenes
