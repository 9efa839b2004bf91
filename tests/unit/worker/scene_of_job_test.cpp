#include "worker/render_job.h"

#include <gtest/gtest.h>

#include "tests/support/paths.h"

namespace pf {
namespace {

Rgb sky_of(const std::vector<std::string>& set) {
  const auto spec = load_job(test::source_dir() / "jobs" / "cornell-box.toml", set);
  EXPECT_TRUE(spec) << spec.error().message;
  const auto scene = load_scene_of_job(*spec);
  EXPECT_TRUE(scene) << scene.error().message;
  return scene ? scene->environment.radiance : Rgb{};
}

TEST(SceneOfJob, ScalesAConstantSky) {
  const std::string radiance = "scene.environment_radiance=[0.25,0.5,1]";
  EXPECT_EQ(sky_of({radiance}), (Rgb{0.25f, 0.5f, 1.0f}));
  EXPECT_EQ(sky_of({radiance, "scene.environment_scale=2"}), (Rgb{0.5f, 1.0f, 2.0f}));
  EXPECT_EQ(sky_of({radiance, "scene.environment_scale=0"}), (Rgb{0.0f, 0.0f, 0.0f}));
  EXPECT_EQ(sky_of({"scene.environment_scale=2"}), (Rgb{0.0f, 0.0f, 0.0f}));
}

}  // namespace
}  // namespace pf
