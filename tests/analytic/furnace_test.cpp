// A closed body whose walls all emit Le and reflect rho is seen as Le / (1 - rho) in every pixel, whatever
// its shape; cut after k reflections, as Le (1 - rho^(k+1)) / (1 - rho). Tests "test-furnace" of Nori and
// pbrt-v3's analytic scenes.

#include <cmath>

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

/// Inverting a measured part of a disc is biased upwards where the part is small: near an edge by 1 %
/// (CoveredArea.MeasuresADiscThatHangsOverAnEdge), at a corner of three walls by a little more.
constexpr double kCoverBias = 0.02;

std::unique_ptr<const Scene> box_of(float rho) {
  SceneMaker maker;
  maker.box({-0.5f, -0.5f, -0.5f}, {0.5f, 0.5f, 0.5f}, maker.emitter({1, 1, 1}, {rho, rho, rho}), true);
  // Into a corner: edges and faces are all in the picture.
  maker.camera({0.2f, 0.1f, 0.15f}, {-0.5f, -0.5f, -0.5f}, 1.6f);
  return maker.build();
}

class Furnace : public testing::TestWithParam<float> {};

TEST_P(Furnace, ABoxIsUniformInEveryPixel) {
  const float rho = GetParam();
  const auto scene = box_of(rho);
  JobSpec spec = job(12, 12, IntegratorType::kPath, 5000);
  spec.integrator.max_depth = 0;
  const double expected = 1.0 / (1.0 - double{rho});
  for_each_algorithm(spec, [&](const char* name, const JobSpec& chosen) {
    SCOPED_TRACE(name);
    const bool path = chosen.integrator.type == IntegratorType::kPath;
    const Renders renders(*scene, chosen, path ? 24 : 4, 10);
    EXPECT_TRUE(agrees(renders.mean(), expected, path ? 0.0 : 0.5 * kCoverBias * expected));
    EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(144, expected), path ? 0.0 : kCoverBias));
  });
}

INSTANTIATE_TEST_SUITE_P(Albedo, Furnace, testing::Values(0.5f, 0.8f),
                         [](const auto& param) { return param.param < 0.6f ? "Half" : "FourFifths"; });

TEST(Furnace, IsCutAfterTheDepthThatTheJobAsksFor) {
  const auto scene = box_of(0.5f);
  for (const int depth : {1, 2, 4}) {
    JobSpec spec = job(4, 4, IntegratorType::kPath, 4000);
    spec.integrator.max_depth = depth;
    const double expected = (1.0 - std::pow(0.5, depth + 1)) / 0.5;
    for_each_algorithm(spec, [&](const char* name, const JobSpec& chosen) {
      SCOPED_TRACE(testing::Message() << name << " depth " << depth);
      const bool path = chosen.integrator.type == IntegratorType::kPath;
      EXPECT_TRUE(
          agrees(Renders(*scene, chosen, path ? 32 : 4, 8).mean(), expected, path ? 0.0 : 0.5 * kCoverBias * expected));
    });
  }
}

TEST(Furnace, ASphereWithObjectsOfTheSameMaterialInsideStaysUniform) {
  SceneMaker maker;
  const int material = maker.emitter({1, 1, 1}, {0.5f, 0.5f, 0.5f});
  maker.sphere({0, 0, 0}, 1.0f, material, 16, true);
  maker.sphere({-0.3f, -0.2f, -0.3f}, 0.25f, material, 12);
  maker.box({0.1f, -0.4f, -0.5f}, {0.4f, 0.0f, -0.2f}, material);
  // Flat shading: interpolated normals would tilt away from the facets, where a BSDF may neither leak nor
  // gain light.
  for (Mesh& mesh : maker.description.meshes) mesh.normals.clear();
  maker.camera({0, 0.1f, 0.8f}, {0, -0.1f, -0.3f}, 1.0f);
  const auto scene = maker.build();
  JobSpec spec = job(12, 12, IntegratorType::kPath, 6000);
  spec.integrator.max_depth = 0;
  for_each_algorithm(spec, [&](const char* name, const JobSpec& chosen) {
    SCOPED_TRACE(name);
    const bool path = chosen.integrator.type == IntegratorType::kPath;
    const Renders renders(*scene, chosen, path ? 24 : 4, 10);
    EXPECT_TRUE(agrees(renders.mean(), 2.0, path ? 0.0 : kCoverBias));
    EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(144, 2.0), path ? 0.0 : 2 * kCoverBias));
  });
}

TEST(Furnace, GlassAndMirrorsInsideItDisappear) {
  // Walls of radiance 2 all around: a body that absorbs nothing shows radiance 2, too (radiance scales with
  // the square of the index and back).
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.emitter({1, 1, 1}, {0.5f, 0.5f, 0.5f}), true);
  maker.sphere({-0.35f, 0, -0.2f}, 0.3f, maker.glass(1.5f), 24);
  maker.sphere({0.35f, 0, -0.2f}, 0.3f, maker.mirror(), 24);
  for (Mesh& mesh : maker.description.meshes) mesh.normals.clear();
  maker.camera({0, 0.1f, 0.9f}, {0, 0, -0.2f}, 1.0f);
  const auto scene = maker.build();
  JobSpec spec = job(12, 12, IntegratorType::kPath, 6000);
  spec.integrator.max_depth = 0;
  for_each_algorithm(spec, [&](const char* name, const JobSpec& chosen) {
    SCOPED_TRACE(name);
    const bool path = chosen.integrator.type == IntegratorType::kPath;
    const Renders renders(*scene, chosen, path ? 24 : 4, 10);
    EXPECT_TRUE(agrees(renders.mean(), 2.0, path ? 0.0 : kCoverBias));
    EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(144, 2.0), path ? 0.0 : 2 * kCoverBias));
  });
}

}  // namespace
}  // namespace pf::test
