// SPPM against path tracing: the same picture by two algorithms that share no estimator of indirect light.

#include <array>

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

/// At equal light, means of blocks of pixels agree within what the density estimate blurs.
void expect_same_image(const Scene& scene, JobSpec spec, int path_samples, int passes, double relative,
                       double absolute) {
  spec.integrator.type = IntegratorType::kPath;
  const Renders reference(scene, spec, static_cast<std::uint64_t>(path_samples), 8);
  spec.integrator.type = IntegratorType::kSppm;
  for (const ProgressiveMode mode : {ProgressiveMode::kShared, ProgressiveMode::kIndependent}) {
    SCOPED_TRACE(to_string(mode));
    spec.integrator.mode = mode;
    const Renders renders(scene, spec, static_cast<std::uint64_t>(passes), 8);
    const auto a = renders.mean(), b = reference.mean();
    EXPECT_TRUE(all_agree(std::array{a}, std::array{b}, relative));
    EXPECT_TRUE(all_agree(renders.blocks(6, 6), reference.blocks(6, 6), 2.0 * relative, absolute));
    EXPECT_TRUE(all_agree(renders.pixels(), reference.pixels(), 4.0 * relative, 4.0 * absolute));
  }
}

TEST(Agreement, OfTheDiffuseBox) {
  const auto scene = diffuse_box().build();
  expect_same_image(*scene, job(24, 24, IntegratorType::kPath, 6000), 48, 6, 0.01, 0.005);
}

SceneMaker glossy_room() {
  SceneMaker maker;
  const int grey = maker.lambert({0.5f, 0.5f, 0.5f});
  maker.box({-1, -1, -1}, {1, 1, 1}, grey, true);
  maker.quad({-0.4f, 0.99f, -0.4f}, {0.8f, 0, 0}, {0, 0, 0.8f}, maker.emitter({5, 5, 5}));
  maker.camera({0, 0, 0.95f}, {0, -0.1f, 0}, 1.1f);
  return maker;
}

TEST(Agreement, OfRoughMetalAndPlastic) {
  SceneMaker maker = glossy_room();
  maker.sphere({-0.4f, -0.6f, -0.2f}, 0.38f, maker.metal({0.9f, 0.8f, 0.6f}, 0.3f), 32);
  maker.sphere({0.45f, -0.6f, -0.1f}, 0.38f, maker.plastic({0.3f, 0.4f, 0.6f}, 0.2f), 32);
  expect_same_image(*maker.build(), job(24, 24, IntegratorType::kPath, 6000), 48, 6, 0.01, 0.005);
}

// Guided photons bring the same light, from walls and from rough metal.
TEST(Agreement, OfGuidedPhotons) {
  JobSpec spec = job(24, 24, IntegratorType::kPath, 6000);
  spec.integrator.guide_emission = Switch::kOn;
  expect_same_image(*diffuse_box().build(), spec, 48, 6, 0.01, 0.005);
  SceneMaker maker = glossy_room();
  maker.sphere({-0.4f, -0.6f, -0.2f}, 0.38f, maker.metal({0.9f, 0.8f, 0.6f}, 0.3f), 32);
  expect_same_image(*maker.build(), spec, 48, 6, 0.01, 0.005);
}

// No threshold between "gather here" and "follow the reflection": at any roughness both give the path
// tracer's mean.
TEST(Agreement, HoldsAtEveryRoughness) {
  for (const float roughness : {0.02f, 0.08f, 0.1f, 0.15f, 0.25f, 0.4f, 0.55f, 0.7f, 0.9f}) {
    SceneMaker maker = glossy_room();
    maker.sphere({0, -0.2f, -0.1f}, 0.5f, maker.metal({0.9f, 0.9f, 0.9f}, roughness), 32);
    maker.description.cameras.clear();
    maker.camera({0, 0, 0.95f}, {0, -0.2f, -0.1f}, 0.6f);  // nothing but the ball
    const auto scene = maker.build();
    JobSpec spec = job(12, 12, IntegratorType::kPath, 5000);
    const std::array reference{Renders(*scene, spec, 96, 10).mean()};
    spec.integrator.type = IntegratorType::kSppm;
    const std::array measured{Renders(*scene, spec, 6, 10).mean()};
    constexpr double kBlur = 0.01;
    EXPECT_TRUE(all_agree(measured, reference, kBlur)) << "roughness " << roughness;
  }
}

}  // namespace
}  // namespace pf::test
