#include "worker/integrators/direct_light.h"

#include <cmath>

#include <gtest/gtest.h>

#include "common/math/philox.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

/// A floor under two lamps and a sky, the near lamp half hidden by a screen.
SceneMaker lit_floor() {
  SceneMaker maker = bare_floor();
  maker.quad({-1.2f, 1, 0.5f}, {1, 0, 0}, {0, 0, -1}, maker.emitter({0, 0, 0}, {0, 0, 0}));  // a screen
  maker.quad({-1.5f, 1.5f, -0.5f}, {1, 0, 0}, {0, 0, 1}, maker.emitter({6, 6, 6}));          // both look down
  maker.quad({1.5f, 1.5f, -0.5f}, {1, 0, 0}, {0, 0, 1}, maker.emitter({2, 2, 2}));
  maker.environment({0.3f, 0.3f, 0.3f});
  return maker;
}

constexpr int kDraws = 20000;

/// Mean and variance of direct light at the middle of a scene's floor, seen from above, with so many samples of lamps.
struct Moments {
  double mean = 0, variance = 0;
  std::uint64_t rays = 0;
};

Moments moments_at_the_middle(const Scene& scene, int samples) {
  const auto hit = scene.intersect(Ray{{0, 0.5f, 0}, {0, -1, 0}});
  EXPECT_TRUE(hit);
  const MediumStack media;
  const Vertex vertex(scene, *hit, {0, 1, 0}, media);
  Moments found;
  double sum = 0, squares = 0;
  for (std::uint32_t i = 0; i < kDraws; ++i) {
    PathRng random(7, Stream::kTest, 0, i);
    const float pick = random.next1();
    const double light = double{luminance(
        direct_light(scene, vertex, media, pick, random.next2(), Portion::kFollow, 0.0f, samples, found.rays))};
    sum += light;
    squares += light * light;
  }
  found.mean = sum / kDraws;
  found.variance = (squares / kDraws - found.mean * found.mean) * kDraws / (kDraws - 1);
  found.rays /= kDraws;
  return found;
}

TEST(DirectLight, OfSeveralSamplesHasTheMeanOfOne) {
  const auto scene = lit_floor().build();
  const Moments one = moments_at_the_middle(*scene, 1);
  for (const int samples : {2, 3, 8}) {
    const Moments several = moments_at_the_middle(*scene, samples);
    const double error = std::sqrt((one.variance + several.variance) / kDraws);
    EXPECT_LT(std::abs(several.mean - one.mean), 4.0 * error) << samples;
    EXPECT_LT(samples * several.variance, 0.9 * one.variance) << samples << ": no better than by chance";
  }
}

TEST(DirectLight, OfTwoEqualLampsAsksBothInOneSampleOfTwo) {
  SceneMaker maker = bare_floor();
  maker.quad({-1.05f, 1, -0.05f}, {0.1f, 0, 0}, {0, 0, 0.1f}, maker.emitter({5, 5, 5}));
  maker.quad({0.95f, 1, -0.05f}, {0.1f, 0, 0}, {0, 0, 0.1f}, maker.emitter({5, 5, 5}));
  // One of them cannot be seen from the middle: the choice between them is all the noise there is.
  maker.quad({0.5f, 0.3f, -0.5f}, {0, 0.4f, 0}, {0, 0, 1}, maker.lambert({0, 0, 0}));
  const auto scene = maker.build();
  const Moments one = moments_at_the_middle(*scene, 1), two = moments_at_the_middle(*scene, 2);
  ASSERT_GT(one.variance, 0.5 * one.mean * one.mean);
  EXPECT_LT(two.variance, 0.02 * one.variance);
  EXPECT_EQ(two.rays, 2u);
}

}  // namespace
}  // namespace pf::test
