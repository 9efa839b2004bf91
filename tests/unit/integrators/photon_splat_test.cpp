#include "worker/integrators/photon_splat.h"

#include <algorithm>
#include <cstdio>
#include <cstring>

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

JobSpec small_splat(SplatKernel kernel = SplatKernel::kEpanechnikov, bool differentials = true) {
  JobSpec spec = job(40, 24, IntegratorType::kPhotonSplat, 6000);
  spec.photon_splat.kernel = kernel;
  spec.photon_splat.differentials = differentials;
  return spec;
}

/// Spheres of rough metal and plastic beside a mirror and a glass ball: every kind of sample and of bounce.
std::unique_ptr<const Scene> mixed_scene() {
  SceneMaker maker = peer_box(16);
  maker.sphere({0.1f, 0.75f, -0.2f}, 0.12f, maker.metal({0.9f, 0.8f, 0.6f}, 0.3f), 16);
  maker.sphere({-0.3f, 0.6f, 0.1f}, 0.1f, maker.plastic({0.3f, 0.4f, 0.6f}, 0.2f), 16);
  maker.sphere({0.3f, 0.55f, 0.2f}, 0.1f, maker.glass(1.4f, {0.9f, 1.0f, 0.9f}, 0.4f), 16);
  return maker.build();
}

Statistics sums_of(const Integrator& integrator, std::uint64_t first, std::uint64_t count) {
  const FilmOptions film = integrator.film_options();
  Statistics sums(film.width, film.height, true, film.extra != Extra::kNone);
  integrator.run({first, count}, {}, sums);
  return sums;
}

void expect_same(const Statistics& a, const Statistics& b) {
  EXPECT_EQ(a.pixels, b.pixels);
  EXPECT_EQ(a.features, b.features);
  EXPECT_EQ(a.extras, b.extras);
  EXPECT_EQ(a.rays, b.rays);
  EXPECT_EQ(a.photons_stored, b.photons_stored);
  EXPECT_EQ(a.photon_paths, b.photon_paths);
  EXPECT_EQ(a.sub_passes, b.sub_passes);
}

// At the foot of a wall a part of a kernel's disc lies where no rays can be: without regard to it about a quarter of
// the light is missing right beside the edge.
TEST(PhotonSplat, LosesNoLightAtTheFootOfAWall) {
  const auto scene = furnace_box().build();
  for (const SplatKernel kernel : {SplatKernel::kEpanechnikov, SplatKernel::kGaussian}) {
    JobSpec spec = job(16, 16, IntegratorType::kPhotonSplat, 5000);
    spec.photon_splat.kernel = kernel;
    spec.integrator.max_depth = 0;
    const Renders renders(*scene, spec, 8, 8, "indirect");
    EXPECT_NEAR(renders.mean().mean, 0.5, 4.0 * renders.mean().error);
    for (const Estimate& e : renders.pixels()) EXPECT_NEAR(e.mean, 0.5, 6.0 * e.error);
  }
}

TEST(PhotonSplat, OneTwoAndFiveThreadsGiveTheSameSums) {
  const auto scene = mixed_scene();
  const PhotonSplatIntegrator integrator(*scene, scene->cameras().front(), small_splat());
  const auto on_threads = [&](int threads) {
    const tbb::global_control allowed(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    Statistics sums;
    tbb::task_arena(threads).execute([&] { sums = sums_of(integrator, 2, 2); });
    return sums;
  };
  const Statistics one = on_threads(1);
  for (const int threads : {2, 5}) {
    SCOPED_TRACE(threads);
    expect_same(on_threads(threads), one);
  }
}

TEST(PhotonSplat, SubPassesAddUpWhoeverRunsThem) {
  const auto scene = mixed_scene();
  const PhotonSplatIntegrator integrator(*scene, scene->cameras().front(), small_splat());
  const Statistics whole = sums_of(integrator, 0, 3);
  Statistics parts = sums_of(integrator, 2, 1);
  ASSERT_TRUE(parts.add(sums_of(integrator, 0, 2)));
  expect_same(parts, whole);
}

TEST(PhotonSplat, EveryOptionChangesThePictureAndLeavesNoFaults) {
  const auto scene = mixed_scene();
  JobSpec smooth = small_splat(), other_seed = small_splat();
  smooth.photon_splat.smoothing = 2.0;
  other_seed.integrator.seed = 2;
  std::vector<std::vector<PixelSums>> pictures;
  for (const JobSpec& spec : {small_splat(), small_splat(SplatKernel::kCone), small_splat(SplatKernel::kGaussian),
                              small_splat(SplatKernel::kEpanechnikov, false), smooth, other_seed}) {
    const PhotonSplatIntegrator integrator(*scene, scene->cameras().front(), spec);
    const Statistics sums = sums_of(integrator, 0, 1);
    EXPECT_EQ(sums.faults.not_finite, 0u);
    EXPECT_EQ(sums.faults.overflow, 0u);
    for (const auto& earlier : pictures) EXPECT_NE(sums.pixels, earlier);
    pictures.push_back(sums.pixels);
  }
}

double mean_of(const Scene& scene, const JobSpec& spec, const char* layer) {
  double sum = 0.0;
  for (const Rgb& p : layer_of(render(scene, spec, 2), layer)) sum += double{average(p)};
  return sum;
}

TEST(PhotonSplat, KeepsLightThatHasNotScatteredToTheEye) {
  // One diffuse floor under a lamp: all light is direct, so photon rays have nothing to bring.
  SceneMaker maker;
  maker.quad({-1, 0, 1}, {2, 0, 0}, {0, 0, -2}, maker.lambert({0.8f, 0.8f, 0.8f}));
  maker.quad({-0.2f, 1, -0.2f}, {0.4f, 0, 0}, {0, 0, 0.4f}, maker.emitter({5, 5, 5}));
  maker.camera({0, 1, 2}, {0, 0, 0}, 0.8f);
  const auto scene = maker.build();
  EXPECT_GT(mean_of(*scene, small_splat(), "direct"), 0.0);
  EXPECT_EQ(mean_of(*scene, small_splat(), "caustics"), 0.0);
  EXPECT_EQ(mean_of(*scene, small_splat(), "indirect"), 0.0);
}

TEST(PhotonSplat, TellsCausticsFromOtherIndirectLight) {
  // A mirror ceiling brings caustics to a floor that nothing else lights; a diffuse one indirect light alone.
  for (const bool mirror : {true, false}) {
    SceneMaker maker;
    maker.quad({-1, 2, -1}, {2, 0, 0}, {0, 0, 2}, mirror ? maker.mirror() : maker.lambert({0.8f, 0.8f, 0.8f}));
    maker.quad({-0.5f, 0, 0.5f}, {1, 0, 0}, {0, 0, -1}, maker.lambert({0.1f, 0.1f, 0.1f}));
    maker.spot_light({0, 1, 0}, {0, 1, 0}, 1.0f, 0.9f, 0.8f);
    maker.camera({0, 1.5f, 0.01f}, {0, 0, 0}, 0.5f);
    const auto scene = maker.build();
    const double caustics = mean_of(*scene, small_splat(), "caustics"),
                 indirect = mean_of(*scene, small_splat(), "indirect");
    if (mirror) {
      EXPECT_GT(caustics, 100.0 * indirect);
    } else {
      EXPECT_EQ(caustics, 0.0);
      EXPECT_GT(indirect, 0.0);
    }
  }
}

TEST(PhotonSplat, ASceneWithoutSurfacesOrWithoutLightIsRendered) {
  SceneMaker dark;
  dark.quad({-1, 0, 1}, {2, 0, 0}, {0, 0, -2}, dark.lambert({0, 0, 0}));
  dark.point_light({0, 1, 0}, 1.0f);
  dark.camera({0, 1, 2}, {0, 0, 0}, 0.8f);
  EXPECT_EQ(mean_of(*dark.build(), small_splat(), ""), 0.0);
  SceneMaker away = dark;
  away.description.cameras.clear();
  away.camera({0, 1, 2}, {0, 5, 9}, 0.3f);  // sees nothing at all
  EXPECT_EQ(mean_of(*away.build(), small_splat(), ""), 0.0);
}

}  // namespace
}  // namespace pf::test
