// A closed box whose walls emit Le and reflect rho: the radiance is Le / (1 - rho) at every point in every
// direction. Things that only send light elsewhere (a perfect mirror, clear glass) or that emit and reflect
// as the walls do cannot be seen in it.

#include "jobs/scenes/generate/gltf.h"
#include "jobs/scenes/generate/scenes.h"

namespace pf::scenes {

std::string make_white_furnace() {
  const Material wall = emitter("wall", Vec3(0.25), Vec3(0.5));  // 0.25 / (1 - 0.5) = 0.5
  Mesh room = box({-1, -1, -1}, {1, 1, 1});
  for (auto& triangle : room.triangles) std::swap(triangle[1], triangle[2]);  // seen, and shining, from inside
  GltfBuilder scene;
  scene.add("room", room, wall);
  scene.add("block", box({-0.75, -0.7, -0.6}, {-0.25, -0.2, -0.1}, 30), wall);
  scene.add_sphere("mirror", {0.35, 0.25, -0.45}, 0.3, 5, metal("mirror", Vec3(1.0), 0.0));
  scene.add_sphere("glass", {0.25, -0.4, 0.0}, 0.25, 5, dielectric("glass", 1.5, 0.5));
  scene.set_camera({0, 0, 0.95}, {0, 0, 0}, 1.2, 4.0 / 3.0);
  return scene.pack();
}

}  // namespace pf::scenes
