#include "worker/photon/irradiance_cache.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/math/sampling.h"

namespace pf {
namespace {

const Box3f kBounds({-1, -1, -1}, {1, 1, 1});
constexpr float kError = 0.2f;

/// Records of radii from small to large on a floor, on its underside, on a wall and outside of the bounds.
IrradianceRecord some_record(PathRng& rng, int i) {
  IrradianceRecord record;
  const Vec2f xz = (rng.next2() - Vec2f(0.5f, 0.5f)) * 2.0f;
  record.position = {xz.x, 0.0f, xz.y};
  record.normal = i % 5 == 0 ? Vec3f{0, -1, 0} : normalize(Vec3f{0.05f * rng.next1(), 1.0f, 0.0f});
  if (i % 7 == 0) {
    record.position = {1.0f, xz.x, xz.y};
    record.normal = {-1, 0, 0};
  }
  if (i % 11 == 0) record.position *= 1.2f;
  record.radius = 0.02f * std::pow(100.0f, rng.next1());
  record.least = 1e-3f;
  record.most = 10.0f;
  record.irradiance = {rng.next1(), rng.next1(), rng.next1()};
  record.rays = 16u << (i % 4);
  for (RgbGradient* gradient : {&record.rotation, &record.translation}) {
    for (Vec3f& g : *gradient) g = sample_sphere(rng.next2()) * 0.2f;
  }
  return record;
}

IrradianceCache some_cache(int count) {
  PathRng rng(1, Stream::kTest, 0, 0);
  IrradianceCache cache(kBounds, kError);
  for (int i = 0; i < count; ++i) cache.insert(some_record(rng, i));
  return cache;
}

TEST(IrradianceCache, ReadsExactlyTheRecordsThatBruteForceReads) {
  const IrradianceCache cache = some_cache(1500);
  PathRng rng(2, Stream::kTest, 0, 1);
  int found = 0, missed = 0;
  for (int i = 0; i < 4000; ++i) {
    IrradianceRecord where = some_record(rng, i);
    where.position += Vec3f{0, 0.003f * (rng.next1() - 0.5f), 0};
    const float tightness = i % 2 == 0 ? 1.0f : 0.6f;
    double weights = 0.0;
    Imath::V3d sum(0.0);
    for (const IrradianceRecord& record : cache.records()) {
      const double w =
          double{IrradianceCache::weight(record, where.position, where.normal, kError * tightness)} * record.rays;
      const Rgb value = record.irradiance + change_along(record.rotation, cross(record.normal, where.normal)) +
                        change_along(record.translation, where.position - record.position);
      sum += Imath::V3d(std::max(value.x, 0.0f), std::max(value.y, 0.0f), std::max(value.z, 0.0f)) * w;
      weights += w;
    }
    const auto read = cache.interpolate(where.position, where.normal, tightness);
    ASSERT_EQ(read.has_value(), weights > 0.0) << i;
    ++(read ? found : missed);
    if (!read) continue;
    // The same terms, added in another order.
    for (int c = 0; c < 3; ++c) ASSERT_NEAR(double{(*read)[c]}, sum[c] / weights, 1e-4) << i;
  }
  EXPECT_GT(found, 300);
  EXPECT_GT(missed, 100);
}

TEST(IrradianceCache, ReadsARecordBackWhereItLies) {
  PathRng rng(3, Stream::kTest, 0, 0);
  IrradianceCache cache(kBounds, kError);
  const IrradianceRecord record = some_record(rng, 1);
  cache.insert(record);
  const auto read = cache.interpolate(record.position, record.normal);
  ASSERT_TRUE(read);
  EXPECT_LT(length(*read - record.irradiance), 1e-6f);
  // Its gradients carry it on: along the surface, and around a bend.
  const Vec3f along = normalize(cross(record.normal, Vec3f{0, 0, 1})) * (0.05f * record.radius);
  const auto moved = cache.interpolate(record.position + along, record.normal);
  ASSERT_TRUE(moved);
  EXPECT_LT(length(*moved - record.irradiance - change_along(record.translation, along)), 1e-6f);
  const Vec3f bent = normalize(record.normal + Vec3f{0.02f, 0, 0.01f});
  const auto turned = cache.interpolate(record.position, bent);
  ASSERT_TRUE(turned);
  EXPECT_LT(length(*turned - record.irradiance - change_along(record.rotation, cross(record.normal, bent))), 1e-6f);
}

TEST(IrradianceCache, DoesNotReadWhatLiesInFrontOrFacesElsewhere) {
  IrradianceRecord record;
  record.normal = {0, 1, 0};
  record.radius = record.most = 1.0f;
  // A step above the point: what shines on it may not shine below.
  EXPECT_GT(IrradianceCache::weight(record, {0.05f, 0.0f, 0}, {0, 1, 0}, kError), 0.0f);
  EXPECT_EQ(IrradianceCache::weight(record, {0.05f, -0.05f, 0}, {0, 1, 0}, kError), 0.0f);
  // Behind the point it counts: what reaches it comes past the point.
  EXPECT_GT(IrradianceCache::weight(record, {0.05f, 0.05f, 0}, {0, 1, 0}, kError), 0.0f);
  EXPECT_EQ(IrradianceCache::weight(record, {0.05f, 0, 0}, {1, 0, 0}, kError), 0.0f);
  EXPECT_EQ(IrradianceCache::weight(record, {0.05f, 0, 0}, {0, -1, 0}, kError), 0.0f);
  // Weights fall to nothing where a record ends.
  EXPECT_LT(IrradianceCache::weight(record, {0.1999f, 0, 0}, {0, 1, 0}, kError), 0.01f);
  EXPECT_EQ(IrradianceCache::weight(record, {0.2001f, 0, 0}, {0, 1, 0}, kError), 0.0f);
}

TEST(IrradianceCache, ANewRecordsRadiusDiffersFromItsNeighboursByNoMoreThanTheirDistance) {
  PathRng rng(1, Stream::kTest, 0, 0);
  IrradianceCache cache(kBounds, kError);
  int pairs = 0;
  for (int i = 0; i < 600; ++i) {
    IrradianceRecord record = some_record(rng, i);
    record.position *= 0.2f;
    cache.insert(record);
    const IrradianceRecord& last = cache.records().back();
    for (const IrradianceRecord& other : cache.records()) {
      const float distance = length(other.position - last.position);
      // Neighbours: one reaches the other.
      if (&other == &last || dot(other.normal, last.normal) < 0.0f) continue;
      if (distance > kError * std::max(other.radius, last.radius)) continue;
      ++pairs;
      ASSERT_LE(std::abs(other.radius - last.radius), distance + 1e-5f) << i;
    }
  }
  EXPECT_GT(pairs, 200);
}

TEST(IrradianceCache, ANearObjectShrinksTheRecordsBeforeIt) {
  IrradianceCache cache(kBounds, kError);
  IrradianceRecord record;
  record.normal = {0, 1, 0};
  record.radius = record.most = 1.0f;
  cache.insert(record);
  record.position = {0.1f, 0, 0};
  record.radius = 0.05f;
  cache.insert(record);
  EXPECT_FLOAT_EQ(cache.records()[0].radius, 0.15f);
  record.position = {-0.1f, 0, 0};
  record.radius = 1.0f;
  cache.insert(record);
  EXPECT_FLOAT_EQ(cache.records()[2].radius, 0.25f);
}

TEST(IrradianceCache, TakesRecordsBackAsTheyWere) {
  const IrradianceCache cache = some_cache(400);
  IrradianceCache copy(kBounds, kError);
  copy.assign(cache.records());
  PathRng rng(4, Stream::kTest, 0, 1);
  for (int i = 0; i < 2000; ++i) {
    const IrradianceRecord where = some_record(rng, i);
    const auto a = cache.interpolate(where.position, where.normal), b = copy.interpolate(where.position, where.normal);
    ASSERT_EQ(a.has_value(), b.has_value());
    // Cells may hold records that shrank since in another order.
    if (a) {
      ASSERT_LT(length(*a - *b), 1e-5f);
    }
  }
}

TEST(IrradianceRecord, IsBoundedByGradientAndSpacing) {
  IrradianceEstimate estimate;
  estimate.irradiance = {2, 2, 2};
  estimate.harmonic_distance = 1.0f;
  IrradianceRecord record;
  record.least = 0.01f;
  record.most = 10.0f;
  set_estimate(record, estimate);
  EXPECT_EQ(record.radius, 1.0f);
  // Halved over 0.2 m: a linear step beyond 0.4 m would find nothing left.
  estimate.translation.fill({5, 0, 0});
  set_estimate(record, estimate);
  EXPECT_NEAR(record.radius, 0.4f, 1e-6f);
  EXPECT_EQ(record.translation[1].x, 5.0f);
  record.most = 0.3f;
  set_estimate(record, estimate);
  EXPECT_EQ(record.radius, 0.3f);
  // A radius that must be larger than that flattens the gradient as much.
  record.least = record.most = 0.8f;
  set_estimate(record, estimate);
  EXPECT_EQ(record.radius, 0.8f);
  EXPECT_NEAR(record.translation[2].x, 2.5f, 1e-6f);
  estimate.harmonic_distance = kInfinity;
  estimate.translation = kNoChange;
  set_estimate(record, estimate);
  EXPECT_EQ(record.radius, 0.8f);
}

}  // namespace
}  // namespace pf
