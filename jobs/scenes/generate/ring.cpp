// A polished ring on a table with a lamp on its rim: seen from above, the inner wall reflects the light of a
// source on its circle into a cardioid (catacaustic of a circle of radius a: x = a (2 cos t + cos 2t) / 3, y
// = a (2 sin t + sin 2t) / 3).

#include "jobs/scenes/generate/gltf.h"
#include "jobs/scenes/generate/profile.h"
#include "jobs/scenes/generate/scenes.h"

namespace pf::scenes {

std::string make_ring() {
  const double inner = 0.050, outer = 0.053, height = 0.030, edge = 0.001;
  const double bottom = -0.002;  // sunk into the table: no light passes below
  const double table = 0.25;
  Profile band({outer, bottom});
  band.line_to({outer, height - edge}, 4)
      .arc({outer - edge, height - edge}, 90, 6)
      .line_to({inner + edge, height})
      .arc({inner + edge, height - edge}, 90, 6)
      .line_to({inner, bottom}, 4)
      .line_to({outer, bottom});
  GltfBuilder scene;
  scene.add("table", quad({-table, 0, table}, {table, 0, table}, {table, 0, -table}, {-table, 0, -table}),
            lambert("table", Vec3(0.62, 0.60, 0.57)));
  scene.add("ring", lathe(band, 256), metal("gold", Vec3(1.0, 0.78, 0.42), 0.04));
  // A sphere of 2 mm, 12 mm above the rim, on the circle of the inner wall.
  scene.add_sphere("lamp", {-0.035, height + 0.012, -0.0357}, 0.002, 3, emitter("lamp", Vec3(420, 395, 350)));
  scene.set_camera({0.03, 0.225, 0.145}, {0.0, 0.010, -0.003}, 0.50, 4.0 / 3.0);
  return scene.pack();
}

}  // namespace pf::scenes
