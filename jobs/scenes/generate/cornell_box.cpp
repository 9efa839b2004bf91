// The Cornell box as measured at Cornell's Program of Computer Graphics
// (graphics.cornell.edu/online/box/data.html), in metres, turned by half a circle about the vertical so that
// the camera looks along -z; its spectra as linear Rec.709.

#include "jobs/scenes/generate/gltf.h"
#include "jobs/scenes/generate/scenes.h"

namespace pf::scenes {
namespace {

/// From the published millimetres (x to the left, z into the box).
Vec3 at(double x, double y, double z) { return Vec3(0.278 - x * 1e-3, y * 1e-3, -z * 1e-3); }

/// A block of the box: its four corners on the floor, in the order published for its top; nothing is drawn
/// below it.
Mesh block(double height, const double (&corners)[4][2]) {
  Mesh mesh;
  const auto p = [&](int i, double y) { return at(corners[i % 4][0], y, corners[i % 4][1]); };
  append_quad(mesh, p(0, height), p(1, height), p(2, height), p(3, height));
  for (int i = 0; i < 4; ++i) append_quad(mesh, p(i, height), p(i, 0), p(i + 1, 0), p(i + 1, height));
  return mesh;
}

}  // namespace

std::string make_cornell_box() {
  const Material white = lambert("white", Vec3(0.73));
  const Material red = lambert("red", Vec3(0.63, 0.065, 0.05));
  const Material green = lambert("green", Vec3(0.14, 0.45, 0.091));
  GltfBuilder scene;
  scene.add("floor", quad(at(552.8, 0, 0), at(0, 0, 0), at(0, 0, 559.2), at(549.6, 0, 559.2)), white);
  scene.add("ceiling", quad(at(556, 548.8, 0), at(556, 548.8, 559.2), at(0, 548.8, 559.2), at(0, 548.8, 0)), white);
  scene.add("back", quad(at(549.6, 0, 559.2), at(0, 0, 559.2), at(0, 548.8, 559.2), at(556, 548.8, 559.2)), white);
  scene.add("left", quad(at(552.8, 0, 0), at(549.6, 0, 559.2), at(556, 548.8, 559.2), at(556, 548.8, 0)), red);
  scene.add("right", quad(at(0, 0, 559.2), at(0, 0, 0), at(0, 548.8, 0), at(0, 548.8, 559.2)), green);
  scene.add("short block", block(165, {{130, 65}, {82, 225}, {240, 272}, {290, 114}}), white);
  scene.add("tall block", block(330, {{423, 247}, {265, 296}, {314, 456}, {472, 406}}), white);
  // One millimetre below the ceiling, in which it lies in the original.
  scene.add("light", quad(at(343, 547.8, 227), at(343, 547.8, 332), at(213, 547.8, 332), at(213, 547.8, 227)),
            emitter("light", Vec3(17, 12, 4)));
  // Focal length 35 mm behind a film of 25 mm: yfov = 2 atan(12.5/35).
  scene.set_camera(at(278, 273, -800), at(278, 273, 0), 0.68614361, 1.0);
  return scene.pack();
}

}  // namespace pf::scenes
