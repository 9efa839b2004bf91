#include "worker/photon/projection_map.h"

#include <gtest/gtest.h>

#include "common/math/philox.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"
#include "worker/photon/photon_tracer.h"

namespace pf {
namespace {

/// A floor and two balls, one of glass, under every kind of light: most directions are empty.
std::unique_ptr<const Scene> sparse_scene(bool with_environment) {
  test::SceneMaker maker;
  const int grey = maker.lambert({0.5f, 0.5f, 0.5f});
  maker.quad({-0.5f, 0, -0.5f}, {0, 0, 1}, {1, 0, 0}, grey);
  maker.sphere({0, 0.4f, 0}, 0.2f, maker.glass(1.5f), 16);
  maker.sphere({3, 0.3f, -2}, 0.3f, grey, 12);
  maker.quad({-1, 2, 0}, {0.5f, 0, 0}, {0, 0.2f, 0.4f}, maker.emitter({4, 4, 4}));
  maker.point_light({0.5f, 1.5f, 1.0f}, 2.0f);
  maker.spot_light({-2, 1.5f, 0.2f}, normalize(Vec3f{1, -0.5f, 0}), 3.0f, 0.95f, 0.8f);
  maker.directional_light(normalize(Vec3f{0.2f, -1, 0.1f}), 0.5f);
  if (with_environment) maker.environment({0.3f, 0.2f, 0.1f});
  maker.camera({0, 1, 3}, {0, 0, 0}, 1.0f);
  return maker.build();
}

ProjectionMap projection_of(const Scene& scene, ProjectionMap::Target target) {
  SurfaceBalls balls(scene.bounds());
  scene.for_each_triangle([&](const std::array<Vec3f, 3>& corners, int material) {
    balls.add(corners, scene.plain_lambert(material) == nullptr);
  });
  return {scene.lights(), scene.bounds(), balls.balls(), target};
}

class ProjectionMapOf : public testing::TestWithParam<bool> {};

TEST_P(ProjectionMapOf, OffCellsNeverHoldAHit) {
  const auto scene = sparse_scene(GetParam());
  const ProjectionMap any = projection_of(*scene, ProjectionMap::Target::kAnySurface);
  const ProjectionMap specular = projection_of(*scene, ProjectionMap::Target::kSpecular);
  EXPECT_LT(specular.on_share(), any.on_share());
  PathRng rng(1, Stream::kTest, 0, 0);
  int off = 0, off_specular = 0;
  for (int i = 0; i < 500000; ++i) {
    const float u_pick = rng.next1();
    const Vec2f u_position = rng.next2(), u_direction = rng.next2();
    const auto probe = any.probe(u_pick, u_position, u_direction);
    const auto specular_probe = specular.probe(u_pick, u_position, u_direction);
    ASSERT_TRUE(probe && specular_probe);
    if (specular_probe->on) continue;
    ++off_specular;
    const auto hit = scene->intersect({probe->picked.emission.origin, probe->picked.emission.direction});
    if (!hit) {
      off += probe->on ? 0 : 1;
      continue;
    }
    ASSERT_TRUE(probe->on);
    ASSERT_NE(scene->plain_lambert(hit->material), nullptr);
  }
  EXPECT_GT(off, 100000);
  EXPECT_GT(off_specular, off);
}

TEST_P(ProjectionMapOf, LosesFewerPhotonsAndKeepsTheMeanFlux) {
  const auto scene = sparse_scene(GetParam());
  const ProjectionMap projection = projection_of(*scene, ProjectionMap::Target::kAnySurface);
  EXPECT_TRUE(projection.sparse());
  PhotonOptions options{5, 20000, 0};
  options.direct = true;
  const PhotonTracer without(*scene, options);
  options.seed = 6;
  options.projection = &projection;
  const PhotonTracer with(*scene, options);
  const auto traced = [](const PhotonTracer& tracer, std::uint64_t& lost) {
    std::array<std::vector<double>, 3> totals;
    for (std::uint64_t s = 0; s < 20; ++s) {
      const PhotonBatch batch = tracer.trace(s);
      lost += batch.lost;
      const Photons* flows[] = {&batch.direct, &batch.flows[kCaustic], &batch.flows[kIndirect]};
      for (std::size_t f = 0; f < 3; ++f) {
        double sum = 0.0;
        for (const Photon& photon : *flows[f]) sum += static_cast<double>(photon.flux.y) * tracer.flux_unit();
        totals[f].push_back(sum);
      }
    }
    std::vector<test::Estimate> means;
    for (const auto& values : totals) means.push_back(test::estimate(values));
    return means;
  };
  std::uint64_t lost_without = 0, lost_with = 0;
  const auto expected = traced(without, lost_without), measured = traced(with, lost_with);
  EXPECT_TRUE(test::all_agree(measured, expected));
  // Nearly all are lost without it; six to ten times as many meet something with it.
  EXPECT_LT(static_cast<double>(lost_with), 0.85 * static_cast<double>(lost_without));
  constexpr std::uint64_t kPaths = 20 * 20000;
  EXPECT_GT(kPaths - lost_with, 4 * (kPaths - lost_without));
  for (std::size_t f = 0; f < 3; ++f) EXPECT_LT(measured[f].error, expected[f].error) << f;
  RecordProperty("lost_without", static_cast<int>(lost_without));
  RecordProperty("lost_with", static_cast<int>(lost_with));
}

INSTANTIATE_TEST_SUITE_P(Lights, ProjectionMapOf, testing::Bool(),
                         [](const auto& param) { return param.param ? "WithEnvironment" : "WithoutEnvironment"; });

TEST(ProjectionMap, CausticPhotonsThroughSpecularCellsKeepTheirMeanFlux) {
  const auto scene = sparse_scene(false);
  const ProjectionMap projection = projection_of(*scene, ProjectionMap::Target::kSpecular);
  PhotonOptions options{5, 20000, 0};
  options.caustics_only = true;
  const PhotonTracer without(*scene, options);
  options.seed = 6;
  options.projection = &projection;
  const PhotonTracer with(*scene, options);
  std::array<std::vector<double>, 2> totals;
  for (std::uint64_t s = 0; s < 20; ++s) {
    for (std::size_t i = 0; i < 2; ++i) {
      const PhotonTracer& tracer = i == 0 ? without : with;
      double sum = 0.0;
      const PhotonBatch batch = tracer.trace(s);
      for (const Photon& photon : batch.flows[kCaustic]) sum += static_cast<double>(photon.flux.y) * tracer.flux_unit();
      totals[i].push_back(sum);
    }
  }
  const std::array without_mean{test::estimate(totals[0])}, with_mean{test::estimate(totals[1])};
  EXPECT_TRUE(test::all_agree(with_mean, without_mean));
  EXPECT_LT(with_mean[0].error, 0.5 * without_mean[0].error);
}

TEST(ProjectionMap, OfAClosedRoomIsOnEverywhere) {
  const auto scene = test::diffuse_box().build();
  const ProjectionMap projection = projection_of(*scene, ProjectionMap::Target::kAnySurface);
  EXPECT_GT(projection.on_share(), 0.9);
  EXPECT_FALSE(projection.sparse());
}

}  // namespace
}  // namespace pf
