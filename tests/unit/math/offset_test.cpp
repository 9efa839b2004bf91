#include "common/math/offset.h"

#include <cmath>

#include <gtest/gtest.h>

#include "common/math/philox.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

using Vec3d = Imath::V3d;

/// Signed t of the ray against the triangle in single precision [Moeller and Trumbore 1997]; NaN for a miss.
float intersect(const Vec3f& o, const Vec3f& d, const Vec3f& p0, const Vec3f& p1, const Vec3f& p2) {
  const Vec3f e1 = p1 - p0, e2 = p2 - p0, h = cross(d, e2), s = o - p0, q = cross(s, e1);
  const float f = 1.0f / dot(e1, h);
  const float u = f * dot(s, h), v = f * dot(d, q);
  return u < 0.0f || v < 0.0f || u + v > 1.0f ? NAN : f * dot(e2, q);
}

TEST(OffsetRayOrigin, LeavesTheSurfaceOnTheSideOfTheRayAtEveryScale) {
  PathRng rng(7, Stream::kTest, 0, 0);
  int tested = 0;
  for (int i = 0; i < 20000; ++i) {
    const float scale = std::pow(10.0f, -4.0f + 9.0f * rng.next1());
    const Vec3f shift = sample_sphere(rng.next2()) * (scale * 3.0f * rng.next1());
    const Vec3f p0 = shift + sample_sphere(rng.next2()) * scale, p1 = shift + sample_sphere(rng.next2()) * scale,
                p2 = shift + sample_sphere(rng.next2()) * scale;
    const Vec3f normal = cross(p1 - p0, p2 - p0);
    if (length(normal) < 0.05f * scale * scale) continue;
    ++tested;
    const Vec3f ng = normalize(normal);
    const Vec2f b = sample_triangle(rng.next2());
    const Vec3f p = p0 * (1.0f - b.x - b.y) + p1 * b.x + p2 * b.y;
    const Vec3f direction = sample_sphere(rng.next2());
    const float extent = std::max(max_magnitude(p0), std::max(max_magnitude(p1), max_magnitude(p2)));
    const Vec3f origin = offset_ray_origin(p, ng, direction, extent);

    const Vec3d exact_ng = (Vec3d(p1) - Vec3d(p0)).cross(Vec3d(p2) - Vec3d(p0)).normalized();
    const double height = (Vec3d(origin) - Vec3d(p0)).dot(exact_ng);
    const double bound = static_cast<double>(kRayOffset) * static_cast<double>(extent);
    EXPECT_GT(dot(direction, ng) >= 0.0f ? height : -height, 0.5 * bound);
    EXPECT_LT(std::abs(height), 1.5 * bound);
    EXPECT_LT((Vec3d(origin) - Vec3d(p)).length(), 1.1 * bound);
    if (std::abs(dot(direction, ng)) > 1e-3f) {
      const float t = intersect(origin, direction, p0, p1, p2);
      EXPECT_FALSE(t > 0.0f) << "meets its own triangle at scale " << scale;
    }
  }
  EXPECT_GT(tested, 15000);
}

TEST(OffsetRayOrigin, MovesHitsAtTheWorldsOriginToo) {
  const Vec3f up(0, 1, 0);
  EXPECT_GT(offset_ray_origin(Vec3f(0, 0, 0), up, up).y, 0.0f);
  EXPECT_LT(offset_ray_origin(Vec3f(0, 0, 0), up, -up).y, 0.0f);
  EXPECT_LT(offset_ray_origin(Vec3f(0, 0, 0), up, up, 1e-3f).y, 1e-7f);
}

}  // namespace
}  // namespace pf
