#include <cmath>
#include <utility>

#include <gtest/gtest.h>

#include "tests/unit/scene/lights_fixtures.h"
#include "worker/scene/lights.h"
#include "worker/scene/punctual.h"

namespace pf {
namespace {

TEST(LightEmission, EmissionCarriesTheTotalFlux) {
  for (std::uint32_t seed = 0; seed < 5; ++seed) {
    const RandomScene scene(seed);
    const Lights lights = scene.lights();
    for (int c = 0; c < 3; ++c) {
      const Estimate e = estimate(20000, [&](PathRng& rng) {
        const float pick = rng.next1();
        const Vec2f position = rng.next2();
        return static_cast<double>(lights.emit(pick, position, rng.next2())->emission.flux[c]);
      });
      const auto expected = static_cast<double>(lights.total_flux()[c]);
      EXPECT_NEAR(e.mean, expected, 5.0 * e.deviation + 1e-5 * expected);
    }
    // The mean of the channels is the same for every photon.
    const Estimate e = estimate(5000, [&](PathRng& rng) {
      const float pick = rng.next1();
      const Vec2f position = rng.next2();
      return static_cast<double>(average(lights.emit(pick, position, rng.next2())->emission.flux));
    });
    EXPECT_LT(e.deviation, 1e-5 * e.mean);
  }
}

TEST(LightEmission, EightPathsStartAsEachWouldAlone) {
  PathRng rng(5, Stream::kTest, 0, 0);
  int triangles = 0, others = 0;
  for (std::uint32_t seed = 0; seed < 17; ++seed) {
    // Many lights; then one triangle, or two that make a parallelogram, lit on one side or on both.
    RandomScene scene = seed < 5 ? RandomScene(seed) : RandomScene(seed, false, false, seed < 11 ? 1 : 2);
    if (seed >= 11) scene.triangles.erase(scene.triangles.begin());
    const Lights lights = scene.lights();
    if (seed >= 5) {
      ASSERT_EQ(lights.area_lights().size(), 1u);
    }
    for (int k = 0; k < 500; ++k) {
      Float8 pick{};
      Vec2x8 position{}, direction{};
      for (std::size_t i = 0; i < kLanes; ++i) {
        pick[i] = rng.next1();
        position.x[i] = rng.next1(), position.y[i] = rng.next1();
        direction.x[i] = rng.next1(), direction.y[i] = rng.next1();
      }
      EmissionLanes emissions;
      lights.emit(pick, position, direction, true, emissions);
      for (std::size_t i = 0; i < kLanes; ++i) {
        const auto alone = lights.emit(pick[i], {position.x[i], position.y[i]}, {direction.x[i], direction.y[i]});
        ASSERT_EQ(alone.has_value(), (emissions.lanes >> i & 1u) != 0);
        if (!alone) continue;
        EXPECT_EQ(alone->emission.origin, emissions.origin[i]);
        EXPECT_EQ(alone->emission.direction, emissions.direction[i]);
        EXPECT_EQ(alone->emission.flux, emissions.flux[i]);
        EXPECT_EQ(alone->triangle, emissions.triangle[i]);
        if (alone->triangle >= 0) {
          EXPECT_EQ(alone->barycentric, emissions.barycentric[i]);
        }
        ++(alone->triangle >= 0 ? triangles : others);
      }
      EmissionLanes without_points;
      lights.emit(pick, position, direction, false, without_points);
      EXPECT_EQ(without_points.lanes, emissions.lanes);
      for_each_lane(emissions.lanes, [&](std::size_t i) {
        EXPECT_EQ(without_points.origin[i], emissions.origin[i]);
        EXPECT_EQ(without_points.direction[i], emissions.direction[i]);
      });
    }
  }
  EXPECT_GT(triangles, 100);
  EXPECT_GT(others, 100);
}

TEST(LightEmission, TotalFluxIsTheSumOfTheClosedForms) {
  PunctualLight point, spot, sun;
  point.intensity = Rgb(2.0f);
  spot.kind = PunctualKind::kSpot;
  spot.intensity = Rgb(3.0f);
  spot.cos_inner = 0.9f;
  spot.cos_outer = 0.6f;
  sun.kind = PunctualKind::kDirectional;
  sun.intensity = Rgb(5.0f);
  const EnvironmentMap environment = sky(Rgb(0.5f));
  auto triangles = quad(Vec3f(0, 0, 0), Vec3f(2, 0, 0), Vec3f(0, 0, 3), Rgb(7.0f), true);
  triangles.push_back(triangle(Vec3f(5, 0, 0), Vec3f(6, 0, 0), Vec3f(5, 1, 0), Rgb(11.0f)));
  const Lights lights = make(triangles, {point, spot, sun}, &environment);
  const double disc = M_PI * 3.0;  // radius sqrt(3) around the box of half-size 1
  const double expected = M_PI * 7.0 * 6.0 * 2.0 + M_PI * 11.0 * 0.5 + 4.0 * M_PI * 2.0 +
                          3.0 * 2.0 * M_PI * (0.1 + 0.3 / 3.0) + 5.0 * disc + 0.5 * 4.0 * M_PI * disc;
  EXPECT_NEAR(lights.total_flux().x, expected, 1e-5 * expected);
  EXPECT_FALSE(lights.empty());
  EXPECT_TRUE(make({}).empty());
  EXPECT_FALSE(make({}).emit(0.5f, Vec2f(0.5f, 0.5f), Vec2f(0.5f, 0.5f)));
  EXPECT_FALSE(make({}).sample(Vec3f(0.0f), kUp, false, 0.5f, Vec2f(0.5f, 0.5f)));
}

TEST(LightEmission, PhotonsFollowTheAngularDistributionOfTheirLight) {
  PunctualLight spot;
  spot.kind = PunctualKind::kSpot;
  spot.direction = normalize(Vec3f(1, 2, -1));
  for (const auto& [inner, outer] : {std::pair(0.9f, 0.5f), std::pair(0.9999f, 0.9995f), std::pair(1.0f, -0.5f)}) {
    spot.cos_inner = inner;
    spot.cos_outer = outer;
    const SpotCone cone(spot);
    // Numeric integral of the falloff, and the mean of f over the sampled density, against closed forms.
    double integral = 0.0, second = 0.0;
    constexpr int kSteps = 200000;
    const double low = static_cast<double>(outer);
    for (int i = 0; i < kSteps; ++i) {
      const auto f = static_cast<double>(cone.falloff(static_cast<float>(low + (1.0 - low) * (i + 0.5) / kSteps)));
      integral += 2.0 * M_PI * f * (1.0 - low) / kSteps;
      second += 2.0 * M_PI * f * f * (1.0 - low) / kSteps;
    }
    EXPECT_NEAR(static_cast<double>(cone.solid_angle()) / integral, 1.0, 2e-3);
    const Lights lights = make({}, {spot});
    const Estimate e = estimate(40000, [&](PathRng& rng) {
      const Vec2f position = rng.next2();
      const auto picked = lights.emit(0.5f, position, rng.next2());
      EXPECT_EQ(picked->emission.origin, spot.position);
      return static_cast<double>(cone.falloff(dot(picked->emission.direction, spot.direction)));
    });
    EXPECT_NEAR(e.mean, second / integral, 5.0 * e.deviation + 4e-3);
  }

  const Lights area = make(quad(Vec3f(0, 1, 0), Vec3f(1, 0, 0), Vec3f(0, 0, 1), Rgb(1.0f), true));
  int above = 0;
  const Estimate cosine = estimate(40000, [&](PathRng& rng) {
    const float pick = rng.next1();
    const Vec2f position = rng.next2();
    const auto e = area.emit(pick, position, rng.next2());
    const float y = e->emission.direction.y;
    above += y > 0.0f ? 1 : 0;
    EXPECT_GT((e->emission.origin.y - 1.0f) * y, 0.0f);  // starts on the side it leaves to
    EXPECT_NEAR(e->emission.origin.y, 1.0f, 1e-4f);
    EXPECT_TRUE(e->triangle == 0 || e->triangle == 1);
    EXPECT_EQ(e->emission.light, static_cast<std::uint32_t>(e->triangle));
    return static_cast<double>(std::abs(y));
  });
  EXPECT_NEAR(cosine.mean, 2.0 / 3.0, 5.0 * cosine.deviation);
  EXPECT_NEAR(above, 20000, 500);
}

TEST(LightEmission, DistantPhotonsComeFromOutsideAndGiveTheIrradianceInside) {
  PunctualLight sun;
  sun.kind = PunctualKind::kDirectional;
  sun.intensity = Rgb(5.0f);
  sun.direction = normalize(Vec3f(1, -2, 0.5f));
  const EnvironmentMap environment = sky(Rgb(0.5f));
  const Box3f bounds(Vec3f(-1, -1, -1), Vec3f(3, 1, 1));
  const Vec3f center(1, 0, 0);
  const float radius = std::sqrt(6.0f);
  for (const bool use_sky : {false, true}) {
    const Lights lights = use_sky ? make({}, {}, &environment, bounds) : make({}, {sun}, nullptr, bounds);
    // Flux through a horizontal square of side 1 in the middle, from above.
    const Estimate e = estimate(100000, [&](PathRng& rng) {
      const Vec2f position = rng.next2();
      const auto picked = lights.emit(0.5f, position, rng.next2());
      const Emission& emission = picked->emission;
      EXPECT_LE(dot(emission.origin - center, emission.direction), -radius);
      const float t = -emission.origin.y / emission.direction.y;
      const Vec3f at = emission.origin + emission.direction * t;
      const bool through = emission.direction.y < 0.0f && std::abs(at.x - 1.0f) < 0.5f && std::abs(at.z) < 0.5f;
      return through ? static_cast<double>(emission.flux.x) : 0.0;
    });
    const double expected = use_sky ? 0.5 * M_PI : 5.0 * static_cast<double>(-sun.direction.y);
    EXPECT_NEAR(e.mean, expected, 5.0 * e.deviation);
  }
}

}  // namespace
}  // namespace pf
