#include "worker/photon/covered_area.h"

#include <gtest/gtest.h>

#include <vector>

#include "common/math/philox.h"
#include "tests/support/scenes.h"

namespace pf {
namespace {

/// Mean of measure_coverage and of its inverse at a point of the floor.
struct Measured {
  double mean = 0, inverse = 0;
};
Measured measure(const Scene& scene, const Vec3f& above, float radius) {
  const auto point = scene.intersect({above, {0, -1, 0}});
  EXPECT_TRUE(point.has_value());
  const DiscQuery query{point->position, {0, 1, 0}, radius * radius, false};
  PathRng rng(4, Stream::kTest, 0, 0);
  Measured m;
  constexpr int kCount = 4000;
  std::uint64_t rays = 0;
  for (int i = 0; i < kCount; ++i) {
    const float f = measure_coverage(scene, *point, query, rng.next2(), rays).fraction;
    m.mean += f / double{kCount};
    m.inverse += 1.0 / f / kCount;
  }
  return m;
}

test::SceneMaker floor_with(bool wall) {
  test::SceneMaker maker;
  const int white = maker.lambert({0.5f, 0.5f, 0.5f});
  maker.quad({0, 0, 0}, {0, 0, 4}, {4, 0, 0}, white);
  if (wall) maker.quad({1, 0, 0}, {0, 4, 0}, {0, 0, 4}, white);  // stands on the floor, which goes on behind it
  maker.camera({2, 2, 2}, {2, 0, 2.1f}, 1.0f);
  return maker;
}

/// Area of a disc of radius 1 on the near side of a line at distance d from its centre, as a part of the disc.
double segment(double d) { return 1.0 - (std::acos(d) - d * std::sqrt(1.0 - d * d)) / double{kPi}; }

TEST(CoveredArea, IsOneOnAnOpenFloor) {
  const auto scene = floor_with(false).build();
  const Measured m = measure(*scene, {2, 1, 2}, 0.2f);
  EXPECT_NEAR(m.mean, 1.0, 1e-9);
}

TEST(CoveredArea, MeasuresADiscThatHangsOverAnEdge) {
  const auto scene = floor_with(false).build();
  for (const double d : {0.1, 0.5, 0.9}) {
    const Measured m = measure(*scene, {static_cast<float>(0.2 * d), 1, 2}, 0.2f);
    EXPECT_NEAR(m.mean, segment(d), 0.01) << d;
    EXPECT_NEAR(m.inverse * segment(d), 1.0, 0.015) << d;
  }
}

TEST(CoveredArea, StopsAtAWallBehindWhichTheFloorGoesOn) {
  const auto scene = floor_with(true).build();
  for (const double d : {0.1, 0.5, 0.9}) {
    const Measured m = measure(*scene, {static_cast<float>(1.0 + 0.2 * d), 1, 2}, 0.2f);
    EXPECT_NEAR(m.mean, segment(d), 0.01) << d;
  }
}

class CoveredAreaOfABall : public testing::TestWithParam<float> {};

TEST_P(CoveredAreaOfABall, IsOne) {
  test::SceneMaker maker;
  maker.sphere({0, 0, 0}, GetParam(), maker.lambert({0.5f, 0.5f, 0.5f}), 128);
  maker.camera({0, 3, 0.1f}, {0, 0, 0}, 1.0f);
  const auto scene = maker.build();
  EXPECT_GT(measure(*scene, {0.0f, 2.0f, 0.0f}, 0.2f).mean, 0.98);
}
INSTANTIATE_TEST_SUITE_P(Radii, CoveredAreaOfABall, testing::Values(0.5f, 0.8f, 2.0f));

TEST(CoveredArea, OfManyDiscsIsThatOfEach) {
  const auto scene = floor_with(true).build();  // a wall at x = 1, an edge at x = 4
  constexpr float kRadius = 0.2f;
  PathRng rng(6, Stream::kTest, 0, 0);
  std::vector<GatherDisc> discs;
  for (int z = 0; z < 16; ++z) {
    for (int x = 0; x < 180; ++x) {
      const Vec3f above{1.02f + 0.0165f * static_cast<float>(x), 1.0f, 1.5f + 0.02f * static_cast<float>(z)};
      const auto point = scene->intersect({above, {0, -1, 0}});
      ASSERT_TRUE(point.has_value());
      discs.push_back({*point, {point->position, {0, 1, 0}, kRadius * kRadius, false}, rng.next2()});
    }
  }
  std::uint64_t rays = 0;
  find_covered_radii(*scene, discs, rays);
  for (const GatherDisc& disc : discs) {
    const float room = std::min(disc.point.position.x - 1.0f, 4.0f - disc.point.position.x);
    if (room > 1.01f * kRadius) {
      EXPECT_EQ(disc.covered_radius, kInfinity) << room;
    } else if (room < 0.7f * kRadius) {
      EXPECT_LT(disc.covered_radius, room + 0.25f * kRadius) << room;  // probes stand so far apart
    }
  }
  EXPECT_LT(rays, discs.size() * 10);
}

}  // namespace
}  // namespace pf
