// Transmission of a plane slab of glass with all its internal reflections: T = (1 - R)^2 t / (1 - R^2 t^2), R
// averaged over polarisations at each interface, t = exp(-sigma d / cos theta_t).

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "common/math/offset.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

constexpr double kIor = 1.5;
constexpr double kThickness = 0.05;
constexpr float kHalfWidth = 16.0f;  // offsets grow with it: absorption must not

/// Fresnel's reflectance of unpolarised light.
double reflectance(double cos_i) {
  const double cos_t = std::sqrt(1.0 - (1.0 - cos_i * cos_i) / (kIor * kIor));
  const double s = (cos_i - kIor * cos_t) / (cos_i + kIor * cos_t);
  const double p = (kIor * cos_i - cos_t) / (kIor * cos_i + cos_t);
  return 0.5 * (s * s + p * p);
}

double cosine_inside(double degrees) {
  const double sin_t = std::sin(degrees * std::numbers::pi / 180.0) / kIor;
  return std::sqrt(1.0 - sin_t * sin_t);
}

/// What a ray that starts `offset` off its surface misses of a slanted way: it hits the other face that much
/// beside, and the two points are nearer to each other by offset sin^2 / cos [m].
double offset_shortening(double degrees) {
  const double cos_t = cosine_inside(degrees);
  return static_cast<double>(kRayOffset) * kHalfWidth * (1.0 - cos_t * cos_t) / cos_t;
}

double transmittance(double degrees, double sigma) {
  const double cos_i = std::cos(degrees * std::numbers::pi / 180.0);
  const double cos_t = cosine_inside(degrees);
  const double r = reflectance(cos_i);
  const double t = std::exp(-sigma * kThickness / cos_t);
  return (1.0 - r) * (1.0 - r) * t / (1.0 - r * r * t * t);
}

int slab_material(SceneMaker& maker, bool absorbing) {
  const int glass = maker.glass(1.5f);
  if (absorbing) {
    maker.description.materials[static_cast<std::size_t>(glass)].attenuation_distance = 0.1f;
    maker.description.materials[static_cast<std::size_t>(glass)].attenuation_color = {0.5f, 0.5f, 0.5f};
  }
  return glass;
}

double sigma_of(bool absorbing) { return absorbing ? std::log(2.0) / 0.1 : 0.0; }

TEST(GlassSlab, TheClosedFormGivesTheTabulatedValues) {
  EXPECT_NEAR(transmittance(0, 0), 0.923077, 1e-6);
  EXPECT_NEAR(transmittance(30, 0), 0.92027, 1e-5);
  EXPECT_NEAR(transmittance(60, 0), 0.83623, 1e-5);
  EXPECT_NEAR(transmittance(75, 0), 0.59609, 1e-5);
}

TEST(GlassSlab, ALampSeenThroughItIsDimmedByTheTransmittance) {
  for (const bool absorbing : {false, true}) {
    for (const double degrees : {0.0, 30.0, 60.0, 75.0}) {
      SceneMaker maker;
      maker.box({-kHalfWidth, 0, -kHalfWidth}, {kHalfWidth, static_cast<float>(kThickness), kHalfWidth},
                slab_material(maker, absorbing));
      maker.quad({-1, -0.1f, -1}, {0, 0, 2}, {2, 0, 0}, maker.emitter({1, 1, 1}));
      const double a = degrees * std::numbers::pi / 180.0;
      maker.orthographic_camera({0.5f * static_cast<float>(std::sin(a)), 0.5f * static_cast<float>(std::cos(a)), 0},
                                {0, 0, 0}, 0.01f, 0.01f);
      const auto scene = maker.build();
      for_each_algorithm(job(2, 2, IntegratorType::kPath, 50), [&](const char* name, const JobSpec& spec) {
        SCOPED_TRACE(testing::Message() << name << " at " << degrees << (absorbing ? " absorbing" : ""));
        const std::uint64_t passes =
            spec.integrator.type == IntegratorType::kPath ? 256 : 8;  // SPPM splits at each face
        const double expected = transmittance(degrees, sigma_of(absorbing));
        const double bias = expected * sigma_of(absorbing) * offset_shortening(degrees);
        EXPECT_TRUE(agrees(Renders(*scene, spec, passes, 6).mean(), expected, bias));
      });
    }
  }
}

TEST(GlassSlab, PhotonsThroughItArriveDimmedByTheTransmittance) {
  for (const bool absorbing : {false, true}) {
    for (const double degrees : {0.0, 45.0, 60.0}) {
      SceneMaker maker;
      maker.quad({-0.25f, 0, -0.25f}, {0, 0, 0.5f}, {0.5f, 0, 0}, maker.lambert({0.5f, 0.5f, 0.5f}));
      maker.box({-0.6f, 0.1f, -0.6f}, {0.6f, 0.1f + static_cast<float>(kThickness), 0.6f},
                slab_material(maker, absorbing));
      const double a = degrees * std::numbers::pi / 180.0;
      maker.directional_light({static_cast<float>(std::sin(a)), static_cast<float>(-std::cos(a)), 0}, 2.0f);
      maker.orthographic_camera({0, 0.05f, 0}, {0, 0, 0}, 0.15f, 0.15f);
      const auto scene = maker.build();
      JobSpec spec = job(6, 6, IntegratorType::kSppm, 10000);
      const double expected = 0.5 / std::numbers::pi * 2.0 * std::cos(a) * transmittance(degrees, sigma_of(absorbing));
      EXPECT_TRUE(agrees(Renders(*scene, spec, 3, 6, "caustics").mean(), expected)) << degrees << " " << absorbing;
    }
  }
}

}  // namespace
}  // namespace pf::test
