#include "worker/photon/photon_tracer.h"

#include <optional>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/scenes.h"

namespace pf {
namespace {

TEST(PhotonTracer, ShootsTheRaysThatItCounts) {
  const auto scene = test::peer_box(16).build();
  const PhotonTracer tracer(*scene, {1, 20000, 0});
  EXPECT_EQ(tracer.rays_of(3).size(), tracer.trace(3).rays);
}

TEST(PhotonTracer, ItsRaysMeetTogetherWhatEachMeetsAlone) {
  const auto scene = test::peer_box(16).build();
  const std::vector<Ray> rays = PhotonTracer(*scene, {1, 20000, 0}).rays_of(0);
  std::vector<std::optional<SurfacePoint>> points(rays.size());
  scene->intersect(rays, points);
  std::size_t differ = 0;  // where two triangles meet either may be found
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const auto alone = scene->intersect(rays[i]);
    if (alone.has_value() != points[i].has_value() || (alone && alone->primitive != points[i]->primitive)) {
      ++differ;
    } else if (alone) {
      EXPECT_NEAR(alone->t, points[i]->t, 1e-5f);
      EXPECT_LT(length(alone->position - points[i]->position), 1e-5f);
    }
  }
  EXPECT_LE(differ, rays.size() / 1000);
}

}  // namespace
}  // namespace pf
