#include "worker/photon/irradiance_hemisphere.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/statistics.h"

namespace pf {
namespace {

/// What a ray from `origin` sees.
struct Seen {
  Rgb radiance;
  float distance;
};

template <typename Look>
HemisphereSamples sample(const HemisphereGrid& grid, const Vec3f& origin, const Frame& frame, PathRng& rng,
                         Look&& look) {
  HemisphereSamples samples{grid, std::vector<Rgb>(grid.cells()), std::vector<float>(grid.cells())};
  for (std::uint32_t cell = 0; cell < grid.cells(); ++cell) {
    const Seen seen = look(origin, frame.to_world(grid.direction(cell, rng.next2())));
    samples.radiance[cell] = seen.radiance;
    samples.distance[cell] = seen.distance;
  }
  return samples;
}

/// A rectangle of radiance 1 in a black plane y = 1.
constexpr float kLeft = -0.3f, kRight = 0.9f, kNear = -0.5f, kFar = 0.4f;

Seen rectangle(const Vec3f& origin, const Vec3f& d) {
  if (d.y <= 0.0f) return {{0, 0, 0}, kInfinity};
  const float t = (1.0f - origin.y) / d.y;
  const Vec3f p = origin + d * t;
  const float lit = p.x > kLeft && p.x < kRight && p.z > kNear && p.z < kFar ? 1.0f : 0.0f;
  return {{lit, 2.0f * lit, 0.0f}, t};
}

/// Irradiance of a polygon of radiance 1 [Lambert 1760; Arvo 1995, (3.1)-(3.3)].
double rectangle_irradiance(const Vec3f& origin, const Vec3f& normal) {
  const Vec3f corners[] = {{kLeft, 1, kNear}, {kRight, 1, kNear}, {kRight, 1, kFar}, {kLeft, 1, kFar}};
  using Vec3d = Imath::V3d;
  const auto towards = [&](int i) { return (Vec3d(corners[i % 4]) - Vec3d(origin)).normalized(); };
  double sum = 0.0;
  for (int i = 0; i < 4; ++i) {
    const Vec3d a = towards(i), b = towards(i + 1);
    sum += std::acos(a.dot(b)) * a.cross(b).normalized().dot(Vec3d(normal));
  }
  return std::abs(0.5 * sum);
}

/// Means over many scrambled hemispheres of what estimate_irradiance() says at `point`.
struct Means {
  std::vector<double> irradiance;
  std::array<std::vector<double>, 3> rotation, translation;
};

Means means_of(const HemisphereGrid& grid, const Vec3f& point, const Vec3f& normal, int runs) {
  Means means;
  const Frame frame = Frame::from_normal(normal);
  for (int run = 0; run < runs; ++run) {
    PathRng rng(1, Stream::kTest, 0, static_cast<std::uint32_t>(run));
    const auto estimate = estimate_irradiance(sample(grid, point, frame, rng, rectangle), frame);
    means.irradiance.push_back(double{estimate.irradiance.x});
    EXPECT_EQ(estimate.irradiance.y, 2.0f * estimate.irradiance.x);
    EXPECT_EQ(estimate.irradiance.z, 0.0f);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      means.rotation[axis].push_back(double{estimate.rotation[0][static_cast<int>(axis)]});
      means.translation[axis].push_back(double{estimate.translation[0][static_cast<int>(axis)]});
    }
  }
  return means;
}

/// Part by which a gradient of these grids is off: walls stand where blocks meet, not where the light's edge
/// is (6 % with 4,096 rays below this lamp, less with more).
constexpr double kGridBias = 0.04;

TEST(IrradianceHemisphere, GradientsUnderARectangularLampAreThoseOfLambertsFormula) {
  const Vec3f point{0.15f, 0.0f, 0.1f};
  for (const Vec3f& normal : {Vec3f{0, 1, 0}, normalize(Vec3f{0.15f, 1.0f, -0.1f})}) {
    const Means means = means_of(HemisphereGrid::of_rays(16384), point, normal, 30);
    EXPECT_TRUE(test::agrees(test::estimate(means.irradiance), rectangle_irradiance(point, normal)));
    constexpr float kStep = 1e-2f;
    const Frame frame = Frame::from_normal(normal);
    double steepest = 0.0;
    for (const Vec3f& t : {frame.t, frame.b}) {
      const double slope =
          (rectangle_irradiance(point + t * kStep, normal) - rectangle_irradiance(point - t * kStep, normal)) /
          (2.0 * double{kStep});
      steepest = std::max(steepest, std::abs(slope));
    }
    for (const Vec3f& t : {frame.t, frame.b}) {
      // Along a tangent.
      std::vector<double> along;
      for (std::size_t run = 0; run < means.irradiance.size(); ++run) {
        double sum = 0.0;
        for (std::size_t axis = 0; axis < 3; ++axis)
          sum += means.translation[axis][run] * double{t[static_cast<int>(axis)]};
        along.push_back(sum);
      }
      const double slope =
          (rectangle_irradiance(point + t * kStep, normal) - rectangle_irradiance(point - t * kStep, normal)) /
          (2.0 * double{kStep});
      EXPECT_TRUE(test::agrees(test::estimate(along), slope, kGridBias * steepest));
      // Turning towards a tangent.
      std::vector<double> turning;
      const Vec3f axis_of_turn = cross(normal, t);
      for (std::size_t run = 0; run < means.irradiance.size(); ++run) {
        double sum = 0.0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          sum += means.rotation[axis][run] * double{axis_of_turn[static_cast<int>(axis)]};
        }
        turning.push_back(sum);
      }
      const auto turned = [&](float by) { return rectangle_irradiance(point, normalize(normal + t * by)); };
      const double change = (turned(kStep) - turned(-kStep)) / (2.0 * double{kStep});
      EXPECT_TRUE(test::agrees(test::estimate(turning), change, kGridBias * rectangle_irradiance(point, normal)));
    }
  }
}

/// Inside of a unit cube whose walls shine smoothly, seen by intersecting its planes.
Seen cube(const Vec3f& origin, const Vec3f& d) {
  float t = kInfinity;
  for (int axis = 0; axis < 3; ++axis) {
    if (d[axis] != 0.0f) t = std::min(t, ((d[axis] > 0.0f ? 1.0f : 0.0f) - origin[axis]) / d[axis]);
  }
  const Vec3f p = origin + d * t;
  return {Rgb{2.0f + std::sin(4.0f * p.x), 1.0f + p.y, 1.0f + p.z * p.x}, t};
}

TEST(IrradianceHemisphere, GradientsInACubeOfSmoothLightAreFiniteDifferences) {
  const Vec3f point{0.3f, 0.0f, 0.4f};
  const Frame frame = Frame::from_normal({0, 1, 0});
  // Differences of estimates with the same numbers: what they have of noise they share.
  const HemisphereGrid fine = HemisphereGrid::of_rays(60000);
  constexpr float kStep = 0.02f;
  const auto irradiance_at = [&](const Vec3f& p, const Frame& f) {
    PathRng rng(2, Stream::kTest, 1, 0);
    return estimate_irradiance(sample(fine, p, f, rng, cube), f).irradiance;
  };
  const Vec3f x{1, 0, 0};
  const Rgb moved =
      (irradiance_at(point + x * kStep, frame) - irradiance_at(point - x * kStep, frame)) / (2.0f * kStep);
  const auto turned_frame = [&](float by) { return Frame::from_normal(normalize(Vec3f{by, 1.0f, 0.0f})); };
  const Rgb turned =
      (irradiance_at(point, turned_frame(kStep)) - irradiance_at(point, turned_frame(-kStep))) / (2.0f * kStep);
  std::array<std::vector<double>, 3> translation, rotation;
  for (std::uint32_t run = 0; run < 40; ++run) {
    PathRng rng(3, Stream::kTest, 2, run);
    const auto estimate = estimate_irradiance(sample(HemisphereGrid::of_rays(1024), point, frame, rng, cube), frame);
    const Rgb along = change_along(estimate.translation, x);
    const Rgb turn = change_along(estimate.rotation, cross(Vec3f{0, 1, 0}, x));
    for (std::size_t c = 0; c < 3; ++c) {
      translation[c].push_back(double{along[static_cast<int>(c)]});
      rotation[c].push_back(double{turn[static_cast<int>(c)]});
    }
  }
  const Rgb level = irradiance_at(point, frame);
  for (std::size_t c = 0; c < 3; ++c) {
    SCOPED_TRACE(c);
    const int i = static_cast<int>(c);
    EXPECT_TRUE(test::agrees(test::estimate(translation[c]), double{moved[i]}, kGridBias * double{level[i]}));
    EXPECT_TRUE(test::agrees(test::estimate(rotation[c]), double{turned[i]}, kGridBias * double{level[i]}));
  }
}

TEST(IrradianceHemisphere, UnderAUniformSkyNothingChangesButWithTheHorizon) {
  const Frame frame = Frame::from_normal(normalize(Vec3f{1, 2, -1}));
  const HemisphereGrid grid = HemisphereGrid::of_rays(512);
  PathRng rng(4, Stream::kTest, 3, 0);
  const auto estimate = estimate_irradiance(sample(grid, {0, 0, 0}, frame, rng,
                                                   [](const Vec3f&, const Vec3f&) {
                                                     return Seen{{1, 1, 1}, kInfinity};
                                                   }),
                                            frame);
  EXPECT_NEAR(estimate.irradiance.x, kPi, 1e-4f);
  EXPECT_TRUE(std::isinf(estimate.harmonic_distance));
  EXPECT_LT(length(estimate.translation[0]), 1e-5f);
  EXPECT_LT(length(estimate.rotation[0]), 1e-4f);
}

TEST(IrradianceHemisphere, CellsOfAGridShareTheHemisphereEvenly) {
  for (const int rays : {1, 16, 100, 512, 5000}) {
    const HemisphereGrid grid = HemisphereGrid::of_rays(rays);
    EXPECT_EQ(grid.rings % 2, 0u);
    EXPECT_EQ(grid.sectors % 2, 0u);
    if (rays >= 100) {
      EXPECT_NEAR(grid.cells(), rays, 0.2 * rays);
    }
    // Corners of neighbouring cells meet: the cells tile the disc below the hemisphere.
    for (std::uint32_t cell = 0; cell + grid.sectors < grid.cells(); ++cell) {
      const Vec3f outer = grid.direction(cell, {1.0f, 0.5f}), inner = grid.direction(cell + grid.sectors, {0.0f, 0.5f});
      ASSERT_LT(length(outer - inner), 1e-5f);
    }
  }
}

}  // namespace
}  // namespace pf
