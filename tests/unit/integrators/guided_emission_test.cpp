#include "worker/integrators/guided_emission.h"

#include <vector>

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_tracer.h"

namespace pf {
namespace {

/// A room with a hole of half a metre in its ceiling, and a lamp high above: one photon in 400 comes in.
std::unique_ptr<const Scene> lit_through_a_hole() {
  test::SceneMaker maker;
  const int grey = maker.lambert({0.5f, 0.5f, 0.5f});
  maker.quad({-1, -1, 1}, {2, 0, 0}, {0, 0, -2}, grey);
  maker.quad({-1, -1, -1}, {2, 0, 0}, {0, 2, 0}, grey);
  maker.quad({1, -1, 1}, {-2, 0, 0}, {0, 2, 0}, grey);
  maker.quad({-1, -1, 1}, {0, 0, -2}, {0, 2, 0}, grey);
  maker.quad({1, -1, -1}, {0, 0, 2}, {0, 2, 0}, grey);
  maker.quad({-1, 1, -1}, {2, 0, 0}, {0, 0, 0.75f}, grey);
  maker.quad({-1, 1, 0.25f}, {2, 0, 0}, {0, 0, 0.75f}, grey);
  maker.quad({-1, 1, -0.25f}, {0.75f, 0, 0}, {0, 0, 0.5f}, grey);
  maker.quad({0.25f, 1, -0.25f}, {0.75f, 0, 0}, {0, 0, 0.5f}, grey);
  maker.point_light({0, 3.8f, 0}, 100);
  maker.camera({0, 0, 0.9f}, {0, -0.3f, 0}, 1.2f);
  return maker.build();
}

JobSpec small_job(IntegratorType type = IntegratorType::kSppm) { return test::job(24, 24, type, 20000); }

TEST(GuidedEmission, LearnsTheSameOnAnyNumberOfThreads) {
  const auto scene = lit_through_a_hole();
  std::vector<LearnedEmission> learned(3);
  const int threads[] = {1, 2, 5};
  for (std::size_t i = 0; i < learned.size(); ++i) {
    tbb::task_arena arena(threads[i]);
    arena.execute([&] { learned[i] = learn_emission(*scene, scene->cameras().front(), small_job()); });
  }
  for (const LearnedEmission& other : learned) {
    EXPECT_EQ(other.gain, learned[0].gain);
    EXPECT_EQ(other.guide.cells(), learned[0].guide.cells());
    for (float u = 0.01f; u < 1.0f; u += 0.07f) {
      const EmissionGuide::Numbers at{u, 1.0f - u, 0.5f * u, 0.3f, u};
      EXPECT_EQ(other.guide.draw(at).u, learned[0].guide.draw(at).u);
      EXPECT_EQ(other.guide.draw(at).weight, learned[0].guide.draw(at).weight);
    }
  }
}

TEST(GuidedEmission, DoesNotDependOnTheJobsSeedOrItsPasses) {
  const auto scene = lit_through_a_hole();
  JobSpec other = small_job();
  other.integrator.seed = 99;
  other.stop.passes = 1000;
  EXPECT_EQ(learn_emission(*scene, scene->cameras().front(), small_job()).gain,
            learn_emission(*scene, scene->cameras().front(), other).gain);
}

TEST(GuidedEmission, GainsWhereTheEyeSeesLittleOfTheLight) {
  const auto scene = lit_through_a_hole();
  const LearnedEmission learned = learn_emission(*scene, scene->cameras().front(), small_job());
  EXPECT_GT(learned.gain, 5.0);
  EXPECT_GT(learned.guide.cells(), 10u);
  EXPECT_GT(learned.rays_per_path, 1.0);
}

TEST(GuidedEmission, HasNothingToGainInAFurnace) {
  const auto scene = test::furnace_box().build();
  EXPECT_LT(learn_emission(*scene, scene->cameras().front(), small_job()).gain, 1.2);
}

TEST(GuidedEmission, OfNoLightIsUniform) {
  const auto scene = test::bare_floor().build();
  const LearnedEmission learned = learn_emission(*scene, scene->cameras().front(), small_job());
  EXPECT_TRUE(learned.guide.uniform());
  EXPECT_EQ(learned.gain, 1.0);
}

/// Sum over blocks of pixels of the relative variance of a run.
double variance_of(const std::vector<test::Estimate>& blocks) {
  double sum = 0;
  for (const test::Estimate& block : blocks) {
    EXPECT_GT(block.mean, 0.0);
    sum += block.error * block.error * block.runs / (block.mean * block.mean);
  }
  return sum;
}

TEST(GuidedEmission, LowersTheNoiseOfTheImageAndKeepsItsMean) {
  const auto scene = lit_through_a_hole();
  JobSpec spec = small_job();
  spec.integrator.initial_radius = 0.15;  // the same discs for both, so that they blur alike
  spec.integrator.mode = ProgressiveMode::kIndependent;
  const auto plain = test::Renders(*scene, spec, 4, 12, "indirect").blocks(4, 4);
  spec.integrator.guide_emission = Switch::kOn;
  const auto guided = test::Renders(*scene, spec, 4, 12, "indirect").blocks(4, 4);
  EXPECT_TRUE(test::all_agree(guided, plain));
  EXPECT_GT(variance_of(plain), 5.0 * variance_of(guided));
}

}  // namespace
}  // namespace pf
