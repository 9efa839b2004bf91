// Light in closed bodies, where a balance of flux gives the answer.

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_tracer.h"

namespace pf::test {
namespace {

// A point light I = pi at the centre of a unit sphere of albedo rho = 1/2: (rho / pi) I / (1 - rho) = 1
// everywhere (pbrt-v3, src/tests/analytic_scenes.cpp).
TEST(FluxBalance, APointLightInASphereGivesUniformRadiance) {
  SceneMaker maker;
  maker.sphere({0, 0, 0}, 1.0f, maker.lambert({0.5f, 0.5f, 0.5f}), 96, true);
  maker.point_light({0, 0, 0}, kPi);
  maker.camera({0.2f, 0, 0.3f}, {-1, 0.3f, -0.4f}, 1.2f);
  const auto scene = maker.build();
  JobSpec spec = job(8, 8, IntegratorType::kPath, 10000);
  spec.integrator.max_depth = 0;
  constexpr double kFacets = 0.002;      // walls of 96 rings lie up to 1 - cos(pi / 192) nearer, and tilted by pi / 192
  constexpr double kDensityBias = 0.01;  // discs are flat, the wall is not
  for_each_algorithm(spec, [&](const char* name, const JobSpec& chosen) {
    SCOPED_TRACE(name);
    const bool path = chosen.integrator.type == IntegratorType::kPath;
    const double bias = kFacets + (path ? 0.0 : kDensityBias);
    const Renders renders(*scene, chosen, path ? 24 : 3, 6);
    EXPECT_TRUE(agrees(renders.mean(), 1.0, bias));
    EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(64, 1.0), bias));
  });
}

SceneMaker cube_with_lamp(float rho) {
  SceneMaker maker;
  maker.box({-2, -2, -2}, {2, 2, 2}, maker.lambert({rho, rho, rho}), true);
  maker.point_light({0, 0, 0}, 10000.0f / (4.0f * kPi));
  return maker;
}

// CIE 171:2006 test 5.8: Phi = 10 klm in a cube of 4 m. Mean irradiance of the walls Phi / (S (1 - rho)). All
// six walls are alike, so the mean of one of them will do.
TEST(FluxBalance, TheMeanIrradianceOfACubesWallIsThatOfCie58) {
  for (const float rho : {0.2f, 0.5f, 0.8f}) {
    SceneMaker maker = cube_with_lamp(rho);
    maker.orthographic_camera({0, -1.5f, 0}, {0, -2, 0}, 2.0f, 2.0f);
    const auto scene = maker.build();
    JobSpec spec = job(12, 12, IntegratorType::kPath, 4000);
    spec.integrator.max_depth = 0;
    const double expected = 10000.0 / (96.0 * (1.0 - double{rho})) * double{rho} / double{kPi};
    for_each_algorithm(spec, [&](const char* name, const JobSpec& chosen) {
      SCOPED_TRACE(testing::Message() << name << " rho " << rho);
      const bool path = chosen.integrator.type == IntegratorType::kPath;
      constexpr double kEdgeBias = 0.01;  // inverse of the covered part of discs at the four edges
      EXPECT_TRUE(
          agrees(Renders(*scene, chosen, path ? 24 : 3, 6).mean(), expected, path ? 0.0 : kEdgeBias * expected));
    });
  }
}

// A photon map holds every hit but the first: Phi (rho + rho^2 + ...) = Phi rho / (1 - rho).
TEST(FluxBalance, StoredPhotonsHoldTheWholeIndirectFlux) {
  for (const float rho : {0.2f, 0.5f, 0.8f}) {
    SceneMaker maker = cube_with_lamp(rho);
    maker.camera({0, 0, 1}, {0, 0, 0}, 1.0f);
    const auto scene = maker.build();
    const PhotonTracer tracer(*scene, {7, 20000, 0});
    std::vector<double> totals;
    for (std::uint64_t sub_pass = 0; sub_pass < 12; ++sub_pass) {
      const PhotonBatch batch = tracer.trace(sub_pass);
      EXPECT_EQ(batch.flows[kCaustic].size(), 0u);
      double sum = 0.0;
      for (const Photon& photon : batch.flows[kIndirect]) sum += double{photon.flux.x} * tracer.flux_unit();
      totals.push_back(sum);
    }
    EXPECT_TRUE(agrees(estimate(totals), 10000.0 * double{rho} / (1.0 - double{rho}))) << rho;
  }
}

}  // namespace
}  // namespace pf::test
