// Light that arrives by an ideal mirror is what the lamp's mirror image would give: the published check of
// photon maps (pab-opto, Radiance photon map). Here it tests that each kind of light emits its photons
// rightly, because nothing but photons brings light from a punctual or distant lamp by a mirror.

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

/// Floor y = 0 of albedo 1/2 and, above it, a mirror at 45 degrees that turns light travelling along +x
/// downwards. The camera sees floor within `half` of the origin.
SceneMaker mirror_over_floor(float half) {
  SceneMaker maker;
  maker.quad({-0.6f, 0, -0.6f}, {0, 0, 1.2f}, {1.2f, 0, 0}, maker.lambert({0.5f, 0.5f, 0.5f}));
  maker.quad({-0.5f, 1.5f, -0.5f}, {0, 0, 1}, {1, -1, 0}, maker.mirror());
  maker.orthographic_camera({0, 0.3f, 0}, {0, 0, 0}, half, half);
  return maker;
}

void expect_caustic(const Scene& scene, double irradiance, std::int64_t photons, std::uint64_t passes, double bias) {
  for (const ProgressiveMode mode : {ProgressiveMode::kShared, ProgressiveMode::kIndependent}) {
    JobSpec spec = job(4, 4, IntegratorType::kSppm, photons);
    spec.integrator.mode = mode;
    const double expected = 0.5 * irradiance / std::numbers::pi;
    EXPECT_TRUE(agrees(Renders(scene, spec, passes, 8, "caustics").mean(), expected, bias * expected))
        << to_string(mode);
  }
}

TEST(Mirror, ASpotsPhotonsArriveAsIfFromItsImage) {
  SceneMaker maker = mirror_over_floor(0.1f);
  maker.spot_light({-1, 1, 0}, {1, 0, 0}, 4.0f, 0.97f, 0.96f);
  // Mean over the square of I cos^3 / D^2 = I D / (D^2 + x^2 + z^2)^(3/2) at D = 2.
  double mean = 0.0;
  constexpr int kSteps = 50;
  for (int i = 0; i < kSteps; ++i) {
    for (int j = 0; j < kSteps; ++j) {
      const double x = 0.1 * (2.0 * (i + 0.5) / kSteps - 1.0);
      const double z = 0.1 * (2.0 * (j + 0.5) / kSteps - 1.0);
      mean += 4.0 * 2.0 / std::pow(4.0 + x * x + z * z, 1.5) / (kSteps * kSteps);
    }
  }
  expect_caustic(*maker.build(), mean, 10000, 6, 0.002);
}

TEST(Mirror, APointLightsPhotonsArriveAsIfFromItsImage) {
  SceneMaker maker = mirror_over_floor(0.1f);
  maker.point_light({-1, 1, 0}, 4.0f);
  expect_caustic(*maker.build(), 1.0, 50000, 6, 0.005);  // mean of cos^3 over the square: at least 0.995
}

TEST(Mirror, ADirectionalLightsPhotonsArriveUndimmed) {
  SceneMaker maker = mirror_over_floor(0.1f);
  maker.directional_light({1, 0, 0}, 3.0f);
  expect_caustic(*maker.build(), 3.0, 20000, 6, 0.0);
}

// A mirror that stands on the floor shows sky where it hides sky, and never the floor itself: irradiance
// stays pi L.
TEST(Mirror, AnEnvironmentsPhotonsAddUpToAUniformSky) {
  SceneMaker maker;
  maker.quad({-0.6f, 0, -0.6f}, {0, 0, 1.2f}, {1.2f, 0, 0}, maker.lambert({0.5f, 0.5f, 0.5f}));
  maker.quad({0.15f, 0, -0.6f}, {0, 0, 1.2f}, {0, 1.0f, 0}, maker.mirror());
  maker.environment({1, 1, 1});
  maker.orthographic_camera({0, 0.3f, 0}, {0, 0, 0}, 0.1f, 0.1f);
  const auto scene = maker.build();
  for_each_algorithm(job(4, 4, IntegratorType::kPath, 20000), [&](const char* name, const JobSpec& spec) {
    SCOPED_TRACE(name);
    const bool path = spec.integrator.type == IntegratorType::kPath;
    EXPECT_TRUE(agrees(Renders(*scene, spec, path ? 256 : 6, 8).mean(), 0.5));
  });
}

}  // namespace
}  // namespace pf::test
