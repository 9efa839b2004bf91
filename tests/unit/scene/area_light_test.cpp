#include "worker/scene/area_light.h"

#include <algorithm>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/unit/scene/lights_fixtures.h"
#include "worker/scene/spherical_shapes.h"

namespace pf {
namespace {

TEST(AreaLight, EverySampleOfASolidAngleIsEquallyLikely) {
  // The mean of 1/pdf is the solid angle; and the counts over a grid of directions fit the density.
  const Vec3f p(0.2f, 0, 0.1f);
  for (const bool rectangle : {true, false}) {
    const Vec3f corner(-0.4f, 0.5f, -0.3f), u(1, 0, 0), v = rectangle ? Vec3f(0, 0.2f, 0.8f) : Vec3f(0.4f, 0.2f, 0.8f);
    const Lights lights = make(quad(corner, u, v, Rgb(1.0f), true));
    const Vec3d o = Vec3d(corner) - Vec3d(p), eu(u), ev(v);
    const double solid_angle =
        triangle_solid_angle(o, o + eu, o + ev) + triangle_solid_angle(o + eu + ev, o + ev, o + eu);
    constexpr int kGrid = 8, kSamples = 64000;
    std::vector<double> counts(kGrid * kGrid, 0.0), expected(kGrid * kGrid, 0.0);
    PathRng rng(9, Stream::kTest, 0, 0);
    for (int i = 0; i < kSamples; ++i) {
      const auto s = lights.sample(p, kUp, true, 0.5f, rng.next2());
      ASSERT_TRUE(s);
      ASSERT_NEAR(1.0 / static_cast<double>(s->sample.pdf_w), solid_angle, 1e-5);
      // Position on the parallelogram by least squares.
      const Vec3d q = Vec3d(p + s->sample.wi * s->sample.distance) - Vec3d(corner);
      const double uu = eu.dot(eu), uv = eu.dot(ev), vv = ev.dot(ev), qu = q.dot(eu), qv = q.dot(ev);
      const double a = (qu * vv - qv * uv) / (uu * vv - uv * uv), b = (qv * uu - qu * uv) / (uu * vv - uv * uv);
      const auto cell = [](double x) { return std::clamp(static_cast<int>(x * kGrid), 0, kGrid - 1); };
      counts[static_cast<std::size_t>(cell(b) * kGrid + cell(a))] += 1.0;
    }
    double chi2 = 0.0;
    for (int y = 0; y < kGrid; ++y) {
      for (int x = 0; x < kGrid; ++x) {
        const Vec3d c = o + eu * (static_cast<double>(x) / kGrid) + ev * (static_cast<double>(y) / kGrid);
        const Vec3d du = eu / kGrid, dv = ev / kGrid;
        const double cell = triangle_solid_angle(c, c + du, c + dv) + triangle_solid_angle(c + du + dv, c + dv, c + du);
        const double mean = cell / solid_angle * kSamples;
        const double count = counts[static_cast<std::size_t>(y * kGrid + x)];
        chi2 += (count - mean) * (count - mean) / mean;
      }
    }
    EXPECT_LT(chi2, 120.0) << "63 degrees of freedom: p = 2e-5";
  }
}

TEST(AreaLight, BothTrianglesOfAParallelogramHaveOneDensity) {
  const Lights lights = make(quad(Vec3f(0, 1, 0), Vec3f(1, 0, 0), Vec3f(0.5f, 0, 1), Rgb(1.0f)));
  ASSERT_EQ(lights.area_lights().size(), 1u);
  EXPECT_FALSE(lights.area_lights()[0].is_rectangle());
  const Vec3f p(0, 0, 0), q(0.7f, 1, 0.5f);
  EXPECT_GT(lights.pdf_w(p, kUp, false, 0, q), 0.0f);
  EXPECT_EQ(lights.pdf_w(p, kUp, false, 0, q), lights.pdf_w(p, kUp, false, 1, q));
}

TEST(AreaLight, PointsOfAParallelogramFindTheirTriangleWhateverTheOrderOfCorners) {
  for (int order = 0; order < 6; ++order) {
    auto pair = quad(Vec3f(0, 1, 0), Vec3f(1, 0, 0), Vec3f(0.5f, 0, 1), Rgb(1.0f));
    EmissiveTriangle& t = pair[1];  // its normal stays, as for the mirrored triangles of an instance
    if (order % 2 == 1) std::swap(t.p0, t.p1);
    for (int turn = 0; turn < order / 2; ++turn) {
      std::swap(t.p0, t.p1);
      std::swap(t.p1, t.p2);
    }
    const Lights lights = make(pair);
    ASSERT_EQ(lights.area_lights().size(), 1u);
    PathRng rng(2, Stream::kTest, 0, 0);
    for (int i = 0; i < 200; ++i) {
      const auto point = lights.area_lights()[0].sample_uniform(rng.next2());
      const EmissiveTriangle& found = lights.triangle(point.triangle);
      const Vec2f b = point.barycentric;
      const Vec3f q = found.p0 * (1.0f - b.x - b.y) + found.p1 * b.x + found.p2 * b.y;
      ASSERT_LT(length(q - point.position), 1e-5f) << "order " << order << " triangle " << point.triangle;
      ASSERT_GE(std::min({b.x, b.y, 1.0f - b.x - b.y}), -1e-5f);
    }
  }
}

TEST(AreaLight, OnlyFlatPairsThatShineAlikeAreMerged) {
  const Vec3f corner(0, 0, 0), u(1, 0, 0), v(0, 0, 1);
  auto pair = quad(corner, u, v, Rgb(1.0f));
  EXPECT_EQ(make(pair).area_lights().size(), 1u);
  pair[1].radiance = Rgb(2.0f);
  EXPECT_EQ(make(pair).area_lights().size(), 2u);
  pair = quad(corner, u, v, Rgb(1.0f));
  pair[1].two_sided = true;
  EXPECT_EQ(make(pair).area_lights().size(), 2u);
  pair = quad(corner, u, v, Rgb(1.0f));
  pair[1].p1 += Vec3f(0, 0.1f, 0);  // bent
  EXPECT_EQ(make(pair).area_lights().size(), 2u);
  pair = quad(corner, u, v, Rgb(1.0f));
  pair[1].p1 += Vec3f(0.1f, 0, 0);  // a kite
  EXPECT_EQ(make(pair).area_lights().size(), 2u);
  // A grid becomes its rectangles, not slanted pairs across them.
  std::vector<EmissiveTriangle> grid;
  for (int i = 0; i < 16; ++i) {
    const auto cell = quad(Vec3f(static_cast<float>(i % 4), 0, static_cast<float>(i / 4)), u, v, Rgb(1.0f));
    grid.insert(grid.begin(), cell.begin(), cell.end());
  }
  const Lights lights = make(grid);
  ASSERT_EQ(lights.area_lights().size(), 16u);
  for (const AreaLight& light : lights.area_lights()) EXPECT_TRUE(light.is_rectangle());
}

}  // namespace
}  // namespace pf
