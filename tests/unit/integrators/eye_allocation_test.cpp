#include "worker/integrators/eye_allocation.h"

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

constexpr int kEdge = 32;            ///< pixels of the image's side
constexpr int kLampsEndColumn = 16;  ///< the lamp covers kCovered of these pixels, all of those before
constexpr double kCovered = 0.48;
constexpr float kRadiance = 2.0f;

/// Half the image is a lamp seen from above, the other half is nothing.
SceneMaker half_a_lamp() {
  SceneMaker maker;
  const auto end = static_cast<float>(2.0 * (kLampsEndColumn + kCovered) / kEdge - 1.0);
  maker.quad({-2, 0, 2}, {end + 2, 0, 0}, {0, 0, -4}, maker.emitter({kRadiance, kRadiance, kRadiance}));
  maker.orthographic_camera({0, 1, 0}, {0, 0, 0}, 1, 1);
  return maker;
}

EyeAllocation allocation_of(const Scene& scene) {
  return {scene, Eye(scene, scene.cameras().front(), kEdge, kEdge, 1), 0, 1};
}

TEST(EyeAllocation, LooksOftenerWhereALampEndsAndKeepsItsBudget) {
  const auto scene = half_a_lamp().build();
  const EyeAllocation allocation = allocation_of(*scene);
  double extra = 0;
  for (int y = 0; y < kEdge; ++y) {
    for (int x = 0; x < kEdge; ++x) {
      const std::uint64_t samples = allocation.samples(static_cast<std::size_t>(y * kEdge + x));
      extra += static_cast<double>(samples - 1);
      if (std::abs(x - kLampsEndColumn) > 1) {
        EXPECT_EQ(samples, 1u) << x << ' ' << y;
      } else if (x == kLampsEndColumn) {
        EXPECT_GT(samples, 1u) << x << ' ' << y;
      }
    }
  }
  // A sample takes one ray wherever it goes.
  constexpr double kMost = EyeAllocation::kExtraShare * kEdge * kEdge;
  EXPECT_LE(extra, kMost);
  EXPECT_GT(extra, 0.5 * kMost);
}

TEST(EyeAllocation, LooksOnceWhereEverySampleSeesTheSame) {
  SceneMaker maker;
  maker.environment({1, 1, 1});
  maker.camera({0, 0, 0}, {0, 0, -1}, 1.0f);
  const auto scene = maker.build();
  const EyeAllocation allocation = allocation_of(*scene);
  for (std::size_t i = 0; i < kEdge * kEdge; ++i) EXPECT_EQ(allocation.samples(i), 1u) << i;
}

/// Averages of several samples a pass have the mean of one, in both modes.
TEST(EyeAllocation, LeavesTheMeanOfAnEdgeAlone) {
  const auto scene = half_a_lamp().build();
  JobSpec spec = job(kEdge, kEdge, IntegratorType::kSppm, 100);
  constexpr int kRuns = 12;
  constexpr std::uint64_t kPasses = 3;
  for (const ProgressiveMode mode : {ProgressiveMode::kShared, ProgressiveMode::kIndependent}) {
    spec.integrator.mode = mode;
    const auto columns = Renders(*scene, spec, kPasses, kRuns).blocks(kEdge, 1);
    EXPECT_TRUE(agrees(columns[kLampsEndColumn], kCovered * kRadiance));
    EXPECT_TRUE(agrees(columns[kLampsEndColumn - 1], kRadiance, kRounding * kRadiance));
    EXPECT_EQ(columns[kLampsEndColumn + 1].mean, 0.0);
  }
}

}  // namespace
}  // namespace pf::test
