// The photon map against answers known without it, and against path tracing.

#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/integrators/photon_map.h"

namespace pf::test {
namespace {

JobSpec map_job(int width, int height, std::int64_t photons, int nearest) {
  JobSpec spec = job(width, height, IntegratorType::kPhotonMap, photons);
  spec.photon_map.caustic_photons = photons;
  spec.photon_map.nearest = nearest;
  spec.photon_map.caustic_nearest = nearest;
  spec.integrator.max_depth = 0;
  return spec;
}

std::unique_ptr<const Scene> furnace(float rho) {
  SceneMaker maker;
  maker.box({-0.5f, -0.5f, -0.5f}, {0.5f, 0.5f, 0.5f}, maker.emitter({1, 1, 1}, {rho, rho, rho}), true);
  maker.camera({0.2f, 0.1f, 0.15f}, {-0.5f, -0.5f, -0.5f}, 1.6f);
  return maker.build();
}

TEST(PhotonMapFurnace, IsUniformInEveryPixelWithEveryFilter) {
  const auto scene = furnace(0.5f);
  for (const PhotonFilter filter : {PhotonFilter::kDisc, PhotonFilter::kCone, PhotonFilter::kGaussian}) {
    JobSpec spec = map_job(12, 12, 20000, 60);
    spec.photon_map.filter = filter;
    // Inverse of a measured part of the disc (Furnace in furnace_test.cpp); weights that fall off know where
    // the edge is.
    const double edge = filter == PhotonFilter::kDisc ? 0.02 : 0.04;
    const Renders renders(*scene, spec, 2, 6);
    EXPECT_TRUE(agrees(renders.mean(), 2.0, edge)) << static_cast<int>(filter);
    EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(144, 2.0), 2 * edge)) << static_cast<int>(filter);
  }
}

TEST(PhotonMapFurnace, ShowsTheWholeLightOfTheMapAlone) {
  // What the map shows is all reflected light: rho Le / (1 - rho).
  const auto scene = furnace(0.5f);
  JobSpec spec = map_job(12, 12, 40000, 60);
  spec.photon_map.show_map = true;
  const Renders renders(*scene, spec, 4, 8);
  EXPECT_TRUE(agrees(renders.mean(), 1.0, 0.02));
  EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(144, 1.0), 0.08));
}

TEST(PhotonMapFurnace, GlassAndMirrorsInsideItDisappear) {
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.emitter({1, 1, 1}, {0.5f, 0.5f, 0.5f}), true);
  maker.sphere({-0.35f, 0, -0.2f}, 0.3f, maker.glass(1.5f), 24);
  maker.sphere({0.35f, 0, -0.2f}, 0.3f, maker.mirror(), 24);
  for (Mesh& mesh : maker.description.meshes) mesh.normals.clear();
  maker.camera({0, 0.1f, 0.9f}, {0, 0, -0.2f}, 1.0f);
  const auto scene = maker.build();
  const Renders renders(*scene, map_job(12, 12, 40000, 60), 4, 8);
  EXPECT_TRUE(agrees(renders.mean(), 2.0, 0.04));
  EXPECT_TRUE(all_agree(renders.pixels(), std::vector<double>(144, 2.0), 0.08));
}

// Point light I = pi in a sphere of albedo 1/2: direct radiance 1/2, indirect 1/2.
TEST(PhotonMapAnalytic, APointLightInASphereIsHalfDirectHalfIndirect) {
  SceneMaker maker;
  maker.sphere({0, 0, 0}, 1.0f, maker.lambert({0.5f, 0.5f, 0.5f}), 96, true);
  maker.point_light({0, 0, 0}, kPi);
  maker.camera({0.2f, 0, 0.3f}, {-1, 0.3f, -0.4f}, 1.2f);
  const auto scene = maker.build();
  const JobSpec spec = map_job(8, 8, 20000, 60);
  constexpr double kCurved = 0.02;  // discs are flat, the wall is not
  EXPECT_TRUE(agrees(Renders(*scene, spec, 2, 4, "direct").mean(), 0.5, 0.002));
  EXPECT_TRUE(agrees(Renders(*scene, spec, 2, 6, "indirect").mean(), 0.5, kCurved * 0.5));
  EXPECT_TRUE(all_agree(Renders(*scene, spec, 2, 6).pixels(), std::vector<double>(64, 1.0), 2 * kCurved));
}

TEST(PhotonMapAgreement, WithPathTracingOfTheDiffuseBox) {
  const auto scene = diffuse_box().build();
  JobSpec spec = map_job(24, 24, 60000, 40);
  const Renders renders(*scene, spec, 4, 5);
  spec.integrator.type = IntegratorType::kPath;
  const Renders reference(*scene, spec, 48, 5);
  EXPECT_TRUE(all_agree(std::array{renders.mean()}, std::array{reference.mean()}, 0.01));
  EXPECT_TRUE(all_agree(renders.blocks(6, 6), reference.blocks(6, 6), 0.03, 0.01));
}

TEST(PhotonMapAgreement, OfCausticsAndSpecularLayersWithPathTracing) {
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.lambert({0.5f, 0.5f, 0.5f}), true);
  maker.quad({-0.4f, 0.99f, -0.4f}, {0.8f, 0, 0}, {0, 0, 0.8f}, maker.emitter({5, 5, 5}));
  maker.sphere({-0.4f, -0.6f, -0.2f}, 0.38f, maker.glass(1.5f), 32);
  maker.sphere({0.45f, -0.6f, -0.1f}, 0.38f, maker.metal({0.9f, 0.8f, 0.6f}, 0.2f), 32);
  maker.camera({0, 0, 0.95f}, {0, -0.1f, 0}, 1.1f);
  const auto scene = maker.build();
  JobSpec spec = map_job(20, 20, 60000, 40);
  spec.integrator.max_depth = 32;
  const Renders renders(*scene, spec, 6, 5);
  spec.integrator.type = IntegratorType::kPath;
  const Renders reference(*scene, spec, 64, 5);
  EXPECT_TRUE(all_agree(std::array{renders.mean()}, std::array{reference.mean()}, 0.015));
  EXPECT_TRUE(all_agree(renders.blocks(5, 5), reference.blocks(5, 5), 0.05, 0.02));
}

// The squared blur of an estimate falls with the area of its disc, k / N: the edge of a shadow in the shown
// map.
TEST(PhotonMapBias, FallsAsPhotonsGrow) {
  SceneMaker maker;
  maker.quad({-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, maker.lambert({1, 1, 1}));
  maker.quad({-4, 1, -4}, {0, 0, 8}, {4, 0, 0}, maker.lambert({0, 0, 0}));  // over the half x < 0
  maker.directional_light({0, -1, 0}, kPi);
  maker.orthographic_camera({0, 0.5f, 0}, {0, 0, 0}, 0.5f, 0.125f);
  const auto scene = maker.build();
  std::array<double, 3> error{};
  for (std::size_t i = 0; i < error.size(); ++i) {
    JobSpec spec = map_job(64, 16, 20000 << (2 * i), 40);
    spec.photon_map.show_map = true;
    spec.photon_map.max_distance = 10.0;
    spec.photon_map.projection_map = Switch::kOff;
    const auto blocks = Renders(*scene, spec, 2, 6).blocks(64, 1);
    for (std::size_t x = 0; x < 64; ++x) error[i] += std::abs(blocks[x].mean - (x < 32 ? 0.0 : 1.0)) / 64.0;
  }
  // Four times the photons: half the radius, and half the width of the blurred edge.
  for (std::size_t i = 1; i < error.size(); ++i)
    EXPECT_NEAR(error[i - 1] / error[i], 2.0, 0.6) << error[i - 1] << ' ' << error[i];
}

}  // namespace
}  // namespace pf::test
