// Irradiance from lamps of known shape, seen as radiance rho E / pi of a Lambert floor.

#include <cmath>
#include <filesystem>
#include <numbers>

#include <gtest/gtest.h>

#include "tests/support/paths.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/scene/gltf_loader.h"

namespace pf::test {
namespace {

constexpr double kRho = 0.5;

/// E / L of a polygon seen from the origin by a surface of normal n [Lambert 1760; Arvo 1995, 3.1 to 3.3].
double polygon_irradiance(const std::vector<Vec3f>& corners, const Vec3f& n) {
  double sum = 0.0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Imath::V3d a = Imath::V3d(corners[i]).normalized();
    const Imath::V3d b = Imath::V3d(corners[(i + 1) % corners.size()]).normalized();
    sum += std::acos(a.dot(b)) * a.cross(b).normalized().dot(Imath::V3d(n));
  }
  return 0.5 * std::abs(sum);
}

/// A floor seen from close above the origin.
SceneMaker floor_at_origin() {
  SceneMaker maker;
  maker.quad({-5, 0, -5}, {0, 0, 10}, {10, 0, 0}, maker.lambert({0.5f, 0.5f, 0.5f}));
  maker.orthographic_camera({0, 0.01f, 0}, {0, 0, 0}, 1e-4f, 1e-4f);
  return maker;
}

void expect_irradiance(const Scene& scene, double irradiance, double bias = 0.0) {
  for_each_algorithm(job(2, 2, IntegratorType::kPath, 20), [&](const char* name, const JobSpec& spec) {
    SCOPED_TRACE(name);
    const double expected = kRho * irradiance / std::numbers::pi;
    EXPECT_TRUE(agrees(Renders(scene, spec, 128, 6).mean(), expected, bias * expected));
  });
}

TEST(AreaLight, ASquareOfSideOneAtHeightOneGivesTheConfigurationFactor) {
  SceneMaker maker = floor_at_origin();
  maker.quad({-0.5f, 1, -0.5f}, {1, 0, 0}, {0, 0, 1}, maker.emitter({1, 1, 1}));
  expect_irradiance(*maker.build(), 4.0 * std::atan(1.0 / std::sqrt(5.0)) / std::sqrt(5.0));
}

TEST(AreaLight, ADiscOnTheAxisGivesLambertsPolygon) {
  SceneMaker maker = floor_at_origin();
  const auto corners = maker.disc({0, 1, 0}, {0, -1, 0}, 0.7f, maker.emitter({1, 1, 1}), 64);
  const double polygon = polygon_irradiance(corners, {0, 1, 0});
  EXPECT_NEAR(polygon, std::numbers::pi * 0.49 / 1.49, 0.002 * polygon);  // pi L R^2 / (R^2 + h^2) for the circle
  expect_irradiance(*maker.build(), polygon);
}

TEST(AreaLight, ASphereGivesWhatItsSolidAngleSays) {
  SceneMaker maker = floor_at_origin();
  maker.sphere({0.6f, 1.2f, 0}, 0.3f, maker.emitter({1, 1, 1}), 48);
  const double d = std::sqrt(0.36 + 1.44);
  constexpr double kFacets = 0.003;  // the inscribed polyhedron's outline encloses up to 1 - cos(pi / 96)^2 less
  expect_irradiance(*maker.build(), std::numbers::pi * 0.09 / (d * d) * (1.2 / d), kFacets);
}

TEST(AreaLight, NorisPolygonsGiveTheRadianceOfItsTests) {
  const struct {
    const char* file;
    double radiance;
  } cases[] = {{"nori_polylum1.glb", 0.0898394}, {"nori_polylum2.glb", 0.02292}};
  for (const auto& [file, radiance] : cases) {
    const auto path = test::shared_dir() / "scenes/analytic" / file;
    if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is absent";
    auto description = load_gltf({.file = path});
    ASSERT_TRUE(description) << description.error().message;
    auto scene = Scene::build(std::move(*description));
    ASSERT_TRUE(scene) << scene.error().message;
    SCOPED_TRACE(file);
    expect_irradiance(**scene, radiance * std::numbers::pi / kRho, 1e-4);  // digits of the published values
  }
}

// Receiver y = 0, seen whole from between; walls reflect nothing, so that its mean radiance is rho L F.
void expect_form_factor(SceneMaker& maker, double factor) {
  maker.quad({-0.5f, 0, -0.5f}, {0, 0, 1}, {1, 0, 0}, maker.lambert({0.5f, 0.5f, 0.5f}));
  maker.orthographic_camera({0, 0.5f, 0}, {0, 0, 0}, 0.5f, 0.5f);
  const auto scene = maker.build();
  const Renders renders(*scene, job(16, 16, IntegratorType::kPath), 32, 8);
  EXPECT_TRUE(agrees(renders.mean(), kRho * factor));
}

TEST(FormFactor, OfOppositeFacesOfACubeIsTheCataloguesValue) {
  SceneMaker maker;
  maker.quad({-0.5f, 1, -0.5f}, {1, 0, 0}, {0, 0, 1}, maker.emitter({1, 1, 1}));
  expect_form_factor(maker, 0.1998249);
}

TEST(FormFactor, OfNeighbouringFacesOfACubeIsTheCataloguesValue) {
  SceneMaker maker;
  maker.quad({-0.5f, 0, -0.5f}, {0, 1, 0}, {0, 0, 1}, maker.emitter({1, 1, 1}));
  expect_form_factor(maker, 0.2000438);
}

TEST(DistantLight, AConstantEnvironmentGivesPiTimesItsRadiance) {
  SceneMaker maker = floor_at_origin();
  maker.environment({1, 1, 1});
  expect_irradiance(*maker.build(), std::numbers::pi);
}

TEST(DistantLight, ADirectionalLightGivesItsIrradianceTimesTheCosine) {
  SceneMaker maker = floor_at_origin();
  maker.directional_light({0.6f, -0.8f, 0}, 3.0f);
  expect_irradiance(*maker.build(), 2.4);
}

TEST(PunctualLight, ASpotGivesIntensityByTheSquareOfTheDistance) {
  SceneMaker maker = floor_at_origin();
  maker.spot_light({0.6f, 0.8f, 0}, {-0.6f, -0.8f, 0}, 5.0f, 0.95f, 0.9f);
  expect_irradiance(*maker.build(), 5.0 * 0.8);
}

}  // namespace
}  // namespace pf::test
