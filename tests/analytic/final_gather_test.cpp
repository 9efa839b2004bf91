// Final gathering against answers known without it, and against path tracing.

#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

JobSpec gather_job(int width, int height, std::int64_t photons, int rays, double error) {
  JobSpec spec = job(width, height, IntegratorType::kFinalGather, photons);
  spec.photon_map.caustic_photons = photons;
  spec.photon_map.nearest = 60;
  spec.photon_map.caustic_nearest = 60;
  spec.final_gather.rays = rays;
  spec.final_gather.error = error;
  spec.integrator.max_depth = 0;
  return spec;
}

TEST(FinalGatherFurnace, IsUniformInEveryPixel) {
  const auto scene = furnace_box().build();
  struct Choice {
    bool precompute;
    double error;
  };
  for (const Choice& choice : {Choice{true, 0.0}, {true, 0.2}, {false, 0.2}}) {
    JobSpec spec = gather_job(12, 12, 8000, 32, choice.error);
    spec.final_gather.precompute = choice.precompute;
    const Renders renders(*scene, spec, choice.precompute ? 4 : 1, 5);
    EXPECT_TRUE(agrees(renders.mean(), 2.0, 0.03)) << choice.precompute << choice.error;
    EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(144, 2.0), 0.05)) << choice.precompute << choice.error;
  }
}

TEST(FinalGatherFurnace, IsCutAfterTheDepthThatTheJobAsksFor) {
  const auto scene = furnace_box().build();
  for (const int depth : {1, 2, 4}) {
    JobSpec spec = gather_job(4, 4, 6000, 32, 0.0);
    spec.integrator.max_depth = depth;
    const double expected = (1.0 - std::pow(0.5, depth + 1)) / 0.5;
    EXPECT_TRUE(agrees(Renders(*scene, spec, 2, 6).mean(), expected, 0.02 * expected)) << depth;
  }
}

TEST(FinalGatherAnalytic, APointLightInASphereGivesUniformRadiance) {
  SceneMaker maker;
  maker.sphere({0, 0, 0}, 1.0f, maker.lambert({0.5f, 0.5f, 0.5f}), 96, true);
  maker.point_light({0, 0, 0}, kPi);
  maker.camera({0.2f, 0, 0.3f}, {-1, 0.3f, -0.4f}, 1.2f);
  const auto scene = maker.build();
  const JobSpec spec = gather_job(8, 8, 10000, 64, 0.2);
  EXPECT_TRUE(agrees(Renders(*scene, spec, 1, 5, "indirect").mean(), 0.5, 0.01));
  EXPECT_TRUE(all_agree(Renders(*scene, spec, 1, 5).pixels(), std::vector<double>(64, 1.0), 0.03));
}

// Whatever the histogram of directions, its share of the rays leaves the mean alone.
TEST(FinalGatherAgreement, ImportanceLeavesTheMeanAndInterpolationTheImage) {
  const auto scene = diffuse_box().build();
  JobSpec spec = gather_job(20, 20, 30000, 48, 0.0);
  spec.integrator.type = IntegratorType::kPath;
  const Renders reference(*scene, spec, 48, 5);
  struct Choice {
    double importance, error;
  };
  for (const Choice& choice : {Choice{0.0, 0.0}, {0.9, 0.0}, {0.5, 0.1}}) {
    spec.integrator.type = IntegratorType::kFinalGather;
    spec.final_gather.importance = choice.importance;
    spec.final_gather.error = choice.error;
    const Renders renders(*scene, spec, 2, 5);
    EXPECT_TRUE(all_agree(std::array{renders.mean()}, std::array{reference.mean()}, 0.01))
        << choice.importance << ' ' << choice.error;
    EXPECT_TRUE(all_agree(renders.blocks(5, 5), reference.blocks(5, 5), 0.02, 0.005))
        << choice.importance << ' ' << choice.error;
  }
}

TEST(FinalGatherAgreement, OfRoughMetalGlassAndPlastic) {
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.lambert({0.5f, 0.5f, 0.5f}), true);
  maker.quad({-0.4f, 0.99f, -0.4f}, {0.8f, 0, 0}, {0, 0, 0.8f}, maker.emitter({5, 5, 5}));
  maker.sphere({-0.55f, -0.6f, -0.3f}, 0.3f, maker.glass(1.5f), 32);
  maker.sphere({0.1f, -0.6f, -0.3f}, 0.3f, maker.metal({0.9f, 0.8f, 0.6f}, 0.5f), 32);
  maker.sphere({0.6f, -0.6f, 0.2f}, 0.3f, maker.plastic({0.3f, 0.4f, 0.6f}, 0.2f), 32);
  maker.camera({0, 0, 0.95f}, {0, -0.1f, 0}, 1.1f);
  const auto scene = maker.build();
  JobSpec spec = gather_job(20, 20, 30000, 32, 0.1);
  spec.integrator.max_depth = 32;
  const Renders renders(*scene, spec, 4, 5);
  spec.integrator.type = IntegratorType::kPath;
  const Renders reference(*scene, spec, 64, 5);
  EXPECT_TRUE(all_agree(std::array{renders.mean()}, std::array{reference.mean()}, 0.015));
  EXPECT_TRUE(all_agree(renders.blocks(5, 5), reference.blocks(5, 5), 0.04, 0.02));
}

}  // namespace
}  // namespace pf::test
