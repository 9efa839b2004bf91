// What lens and pixel filter may not change.

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

TEST(Lens, LeavesAUniformSceneUniform) {
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.emitter({1, 1, 1}), true);
  maker.camera({0, 0, 0.5f}, {0, 0, -1}, 1.0f);
  maker.description.cameras.back().lens_radius = 0.2f;
  maker.description.cameras.back().focus_distance = 0.7f;
  const auto scene = maker.build();
  for_each_algorithm(job(4, 4, IntegratorType::kPath, 20), [&](const char* name, const JobSpec& spec) {
    SCOPED_TRACE(name);
    EXPECT_TRUE(all_agree(Renders(*scene, spec, 4, 4).pixels(), std::vector<double>(16, 1.0)));
  });
}

// A half plane of light, out of focus: by symmetry the pixel at its edge still sees half of it; in focus,
// too.
TEST(Lens, APixelHalfCoveredByALampShowsHalfItsRadiance) {
  for (const float lens : {0.0f, 0.1f}) {
    SceneMaker maker;
    maker.quad({-10, -10, -2}, {10, 0, 0}, {0, 20, 0}, maker.emitter({1, 1, 1}));
    maker.camera({0, 0, 0}, {0, 0, -1}, 0.5f);
    maker.description.cameras.back().lens_radius = lens;
    maker.description.cameras.back().focus_distance = 1.0f;
    const auto scene = maker.build();
    for_each_algorithm(job(1, 1, IntegratorType::kPath, 20), [&](const char* name, const JobSpec& spec) {
      SCOPED_TRACE(testing::Message() << name << " lens " << lens);
      EXPECT_TRUE(agrees(Renders(*scene, spec, 256, 8).mean(), 0.5));
    });
  }
}

}  // namespace
}  // namespace pf::test
