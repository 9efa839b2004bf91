#include "common/math/sampling.h"
#include "common/math/lane_sampling.h"

#include <gtest/gtest.h>

#include "common/math/philox.h"

namespace pf {
namespace {

/// The map as Shirley and Chiu write it, with the library's sine and cosine.
Vec2f disk_by_the_book(const Vec2f& u) {
  const float x = 2.0f * u.x - 1.0f, y = 2.0f * u.y - 1.0f;
  if (x == 0.0f && y == 0.0f) return {0.0f, 0.0f};
  const bool wide = std::abs(x) > std::abs(y);
  const float theta = wide ? (kPi / 4.0f) * (y / x) : (kPi / 2.0f) - (kPi / 4.0f) * (x / y);
  const float r = wide ? x : y;
  return {r * std::cos(theta), r * std::sin(theta)};
}

// glibc gives the same floats; another library may round the last place otherwise.
TEST(SampleDisk, IsTheConcentricMapToTheLastPlace) {
  PathRng rng(5, Stream::kTest, 0, 0);
  for (int k = 0; k < 1000000; ++k) {
    Vec2f u = rng.next2();
    if (k % 10 == 0) u.x = u.y;  // the seams between the four wedges
    if (k % 10 == 1) u.x = 1.0f - u.y;
    if (k % 10 == 2) u.x = 0.5f;
    if (k % 10 == 3) u.y = 0.5f;
    const Vec2f point = sample_disk(u), expected = disk_by_the_book(u);
    ASSERT_LE(std::abs(point.x - expected.x), std::abs(expected.x) * 0x1p-23f) << u.x << " " << u.y;
    ASSERT_LE(std::abs(point.y - expected.y), std::abs(expected.y) * 0x1p-23f) << u.x << " " << u.y;
  }
}

TEST(SampleDisk, GivesEightPointsAsOneByOne) {
  PathRng rng(6, Stream::kTest, 0, 0);
  for (int k = 0; k < 100000; ++k) {
    Vec2x8 u{};
    for (std::size_t i = 0; i < kLanes; ++i) u.x[i] = rng.next1(), u.y[i] = rng.next1();
    u.x[1] = u.y[1];
    u.x[2] = 1.0f - u.y[2];
    u.x[3] = 0.5f;
    u.y[4] = 0.5f;
    u.x[5] = u.y[5] = 0.5f;
    const Vec2x8 points = sample_disk(u);
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Vec2f point = sample_disk(Vec2f(u.x[i], u.y[i]));
      ASSERT_EQ(point.x, points.x[i]) << u.x[i] << " " << u.y[i];
      ASSERT_EQ(point.y, points.y[i]) << u.x[i] << " " << u.y[i];
    }
  }
}

}  // namespace
}  // namespace pf
