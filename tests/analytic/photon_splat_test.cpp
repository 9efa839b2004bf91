// Photon ray splatting against closed forms and the path tracer. Its bias is the blur of its kernels: the tolerances
// say how large that is in each scene.

#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/photon_tree.h"

namespace pf::test {
namespace {

JobSpec splat_job(int width, int height, std::int64_t photons, double smoothing = 1.0) {
  JobSpec spec = job(width, height, IntegratorType::kPhotonSplat, photons);
  spec.photon_splat.smoothing = smoothing;
  return spec;
}

TEST(PhotonSplatFurnace, ABoxIsUniformButForTheFootOfItsWalls) {
  JobSpec spec = splat_job(12, 12, 20000);
  spec.integrator.max_depth = 0;
  const Renders renders(*furnace_box().build(), spec, 2, 10);
  // In corners of several walls a part of the disc across a ray still lies inside one of them.
  constexpr double kFoot = 0.01, kCorner = 0.08;
  EXPECT_TRUE(agrees(renders.mean(), 2.0, kFoot * 2.0));
  EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(144, 2.0), kCorner));
}

TEST(PhotonSplatFurnace, ItsBiasFallsWithTheSmoothing) {
  const auto scene = furnace_box().build();
  std::vector<double> bias;
  for (const double smoothing : {4.0, 2.0, 1.0}) {
    JobSpec spec = splat_job(16, 16, 5000, smoothing);
    spec.integrator.max_depth = 0;
    bias.push_back(0.5 - Renders(*scene, spec, 4, 8, "indirect").mean().mean);
  }
  // What kernels lose beside walls is given back at the foot of one wall; corners of several are left, and kernels as
  // wide as the room: the loss falls at least as fast as the width.
  EXPECT_LT(bias[1], 0.5 * bias[0]) << bias[0] << " " << bias[1] << " " << bias[2];
  EXPECT_LT(std::abs(bias[2]), 0.25 * bias[0]) << bias[0] << " " << bias[1] << " " << bias[2];
}

TEST(PhotonSplatAnalytic, ASphereAroundALampIsUniform) {
  // Point light of I = pi W/sr in a unit sphere of albedo 1/2: L = (rho / pi) I / (1 - rho) = 1.
  SceneMaker maker;
  maker.sphere({0, 0, 0}, 1.0f, maker.lambert({0.5f, 0.5f, 0.5f}), 32, true);
  maker.point_light({0, 0, 0}, kPi);
  maker.camera({0.1f, 0.2f, 0.3f}, {-1, 0, 0}, 1.3f);
  JobSpec spec = splat_job(12, 12, 20000);
  spec.integrator.max_depth = 0;
  const Renders renders(*maker.build(), spec, 2, 10);
  constexpr double kCurved = 0.02;  // facets, and kernels wide against the sphere
  EXPECT_TRUE(agrees(renders.mean(), 1.0, kCurved));
  EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(144, 1.0), 2.0 * kCurved));
}

/// A small table floating under a mirror ceiling with a point light between them: the light's image, 3 m above the
/// table, lights it and nothing blocks it. The camera looks down on one edge of the table.
constexpr float kImageHeight = 3.0f;
constexpr float kHalfTable = 0.25f;
std::unique_ptr<const Scene> table_under_mirror() {
  SceneMaker maker;
  maker.quad({-4, 2, -4}, {8, 0, 0}, {0, 0, 8}, maker.mirror());
  maker.quad({-kHalfTable, 0, kHalfTable}, {2 * kHalfTable, 0, 0}, {0, 0, -2 * kHalfTable},
             maker.lambert({0.5f, 0.5f, 0.5f}));
  maker.spot_light({0, 1, 0}, {0, 1, 0}, 10.0f, 0.5f, 0.4f);
  maker.orthographic_camera({0, 0.9f, 0}, {0, 0, 0}, kHalfTable, kHalfTable);
  return maker.build();
}
double table_radiance(double x, double z) {
  const double d2 = x * x + z * z + double{kImageHeight} * kImageHeight;
  return 0.5 / double{kPi} * 10.0 * double{kImageHeight} / (d2 * std::sqrt(d2));
}

TEST(PhotonSplatAnalytic, LightsATableUpToItsEdges) {
  constexpr int kSize = 10;
  const auto scene = table_under_mirror();
  for (const SplatKernel kernel : {SplatKernel::kEpanechnikov, SplatKernel::kCone, SplatKernel::kGaussian}) {
    JobSpec spec = splat_job(kSize, kSize, 20000, 2.0);
    spec.photon_splat.kernel = kernel;
    const Renders renders(*scene, spec, 3, 10, "caustics");
    std::vector<double> expected;
    for (int i = 0; i < kSize * kSize; ++i) {
      const auto metres = [](int k) { return double{kHalfTable} * (2.0 * (k + 0.5) / kSize - 1.0); };
      expected.push_back(table_radiance(metres(i % kSize), metres(i / kSize)));
    }
    constexpr double kBlur = 0.005;
    EXPECT_TRUE(all_agree(renders.pixels(), expected, kBlur)) << static_cast<int>(kernel);
  }
}

/// At equal light, means of blocks of pixels agree within what the kernels blur.
void expect_same_image(const Scene& scene, JobSpec spec, double relative, double absolute) {
  spec.integrator.type = IntegratorType::kPath;
  const Renders reference(scene, spec, 48, 8);
  spec.integrator.type = IntegratorType::kPhotonSplat;
  for (const bool differentials : {true, false}) {
    SCOPED_TRACE(differentials);
    spec.photon_splat.differentials = differentials;
    const Renders renders(scene, spec, 3, 8);
    EXPECT_TRUE(all_agree(std::array{renders.mean()}, std::array{reference.mean()}, relative));
    EXPECT_TRUE(all_agree(renders.blocks(6, 6), reference.blocks(6, 6), 2.0 * relative, absolute));
  }
}

TEST(PhotonSplatAgreement, OfTheDiffuseBox) {
  expect_same_image(*diffuse_box().build(), splat_job(24, 24, 8000, 0.7), 0.01, 0.01);
}

TEST(PhotonSplatAgreement, OfRoughMetalAndPlastic) {
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.lambert({0.5f, 0.5f, 0.5f}), true);
  maker.quad({-0.4f, 0.99f, -0.4f}, {0.8f, 0, 0}, {0, 0, 0.8f}, maker.emitter({5, 5, 5}));
  maker.sphere({-0.4f, -0.6f, -0.2f}, 0.38f, maker.metal({0.9f, 0.8f, 0.6f}, 0.3f), 32);
  maker.sphere({0.45f, -0.6f, -0.1f}, 0.38f, maker.plastic({0.3f, 0.4f, 0.6f}, 0.2f), 32);
  maker.camera({0, 0, 0.95f}, {0, -0.1f, 0}, 1.1f);
  expect_same_image(*maker.build(), splat_job(24, 24, 8000, 0.7), 0.01, 0.01);
}

}  // namespace
}  // namespace pf::test
