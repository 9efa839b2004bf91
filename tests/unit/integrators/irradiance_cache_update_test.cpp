// An irradiance cache kept in a file while the scene changes: what is kept has not changed, and what comes
// out is what a cold build gives, for less.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <vector>

#include "common/base/atomic_file.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"
#include "worker/integrators/gather_path.h"
#include "worker/integrators/irradiance_cache.h"

namespace pf::test {
namespace {

/// Two rooms without a roof, seen from above, joined by a door. The lamp of the left one is always there.
struct Rooms {
  float block = 0.7f;  ///< where in the right room a block stands
  bool right_lamp = true;
  bool left_block = true;

  [[nodiscard]] SceneMaker make() const {
    SceneMaker maker;
    const int grey = maker.lambert({0.6f, 0.6f, 0.6f}), red = maker.lambert({0.6f, 0.2f, 0.2f});
    const int lamp = maker.emitter({6, 6, 6});
    maker.quad({-2, 0, -1}, {0, 0, 2}, {4, 0, 0}, grey);
    maker.quad({-2, 0, -1}, {0, 1, 0}, {0, 0, 2}, red);
    maker.quad({2, 0, -1}, {0, 0, 2}, {0, 1, 0}, red);
    maker.quad({-2, 0, -1}, {4, 0, 0}, {0, 1, 0}, grey);
    maker.quad({-2, 0, 1}, {0, 1, 0}, {4, 0, 0}, grey);
    maker.box({-0.05f, 0, -1}, {0.05f, 1, 0.85f}, grey);
    maker.quad({-1.2f, 0.9f, -0.2f}, {0.3f, 0, 0}, {0, 0, 0.3f}, lamp);
    if (right_lamp) maker.quad({1.2f, 0.9f, -0.2f}, {0.3f, 0, 0}, {0, 0, 0.3f}, lamp);
    maker.box({block, 0, -0.6f}, {block + 0.3f, 0.3f, -0.3f}, grey);
    if (left_block) maker.box({-1.4f, 0, 0.3f}, {-1.1f, 0.3f, 0.6f}, grey);
    maker.camera({0, 4, 0.01f}, {0, 0, 0}, 0.6f);
    return maker;
  }
};

struct Change {
  const char* name;
  Rooms before, after;
};
const std::array<Change, 3> kChanges{{{"AMovedObject", {.block = 0.7f}, {.block = 1.3f}},
                                      {"ANewLight", {.right_lamp = false}, {.right_lamp = true}},
                                      {"ARemovedLight", {.right_lamp = true}, {.right_lamp = false}}}};

JobSpec spec_of(const TempFolder& folder, std::uint64_t seed) {
  JobSpec spec = job(40, 20, IntegratorType::kIrradianceCache);
  spec.folder = folder.path();
  spec.integrator.seed = seed;
  spec.irradiance_cache.source = GatherSource::kPath;
  spec.irradiance_cache.rays = 1024;
  spec.irradiance_cache.error = 0.2;
  spec.irradiance_cache.min_spacing = 1.5;
  spec.photon_map.caustic_photons = 1000;  // nothing here is specular
  spec.cache.file = "records.cache";
  return spec;
}

/// A scene and an integrator that looks at it.
struct Looked {
  SceneMaker maker;
  std::unique_ptr<const Scene> scene;
  std::unique_ptr<const IrradianceCacheIntegrator> integrator;

  Looked(const Rooms& rooms, const JobSpec& spec) : maker(rooms.make()), scene(maker.build()) {
    auto parts = scene_parts(maker.description);
    EXPECT_TRUE(parts);
    integrator = std::make_unique<IrradianceCacheIntegrator>(*scene, scene->cameras().front(), spec, std::move(*parts));
    EXPECT_FALSE(integrator->file_error()) << integrator->file_error()->message;
  }
};

class IrradianceCacheUpdate : public testing::TestWithParam<Change> {};

TEST_P(IrradianceCacheUpdate, EqualsAColdBuildForAPartOfTheGatherRays) {
  constexpr int kRuns = 5;
  std::vector<std::vector<std::vector<double>>> values(2, std::vector<std::vector<double>>(8));
  double rays_updated = 0.0, rays_cold = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    for (const bool cold : {false, true}) {
      const TempFolder folder;
      const JobSpec spec = spec_of(folder, static_cast<std::uint64_t>(cold ? 100 + run : 1 + run));
      if (!cold) Looked(GetParam().before, spec);
      const Looked looked(GetParam().after, spec);
      (cold ? rays_cold : rays_updated) += static_cast<double>(looked.integrator->figures().gather_rays);
      const auto image = layer_of(render(*looked.integrator, 8), "indirect");
      for (std::size_t block = 0; block < 8; ++block) {
        double sum = 0.0;
        for (std::size_t y = 0; y < 20; ++y) {
          for (std::size_t x = 0; x < 5; ++x) sum += double{average(image[y * 40 + block * 5 + x])} / 100.0;
        }
        values[cold][block].push_back(sum);
      }
    }
  }
  std::vector<Estimate> updated, cold;
  for (std::size_t block = 0; block < 8; ++block) {
    updated.push_back(estimate(values[0][block]));
    cold.push_back(estimate(values[1][block]));
  }
  EXPECT_TRUE(all_agree(updated, cold, double{kTouchedPart}));
  RecordProperty("part_of_gather_rays", std::to_string(rays_updated / rays_cold));
  EXPECT_LT(rays_updated, 0.75 * rays_cold) << rays_updated / rays_cold;
}

TEST_P(IrradianceCacheUpdate, KeepsNoRecordThatTheChangeAlters) {
  const TempFolder folder;
  const JobSpec spec = spec_of(folder, 3);
  const Looked before(GetParam().before, spec), after(GetParam().after, spec);
  EXPECT_GT(after.integrator->figures().kept, 50u);
  EXPECT_GT(after.integrator->figures().renewed, 50u);
  // What each record that was kept should hold in either scene, by gathers that know of no cache.
  const auto irradiance_of = [&](const Looked& looked, const IrradianceRecord& record, std::uint64_t seed) {
    const PathGather source(*looked.scene, spec.integrator.max_depth);
    const IrradianceBuilder builder(*looked.scene, source, spec.irradiance_cache, seed);
    std::vector<double> values;
    for (std::uint64_t run = 0; run < 12; ++run) {
      TileFigures figures;
      const auto samples = builder.gather(GatherPlace(record, {}), HemisphereGrid::of_rays(256), run, figures);
      values.push_back(double{average(estimate_irradiance(samples, Frame::from_normal(record.normal)).irradiance)});
    }
    return estimate(values);
  };
  std::vector<Estimate> old_values, new_values;
  std::size_t kept = 0;
  for (const IrradianceRecord& record : after.integrator->cache().records()) {
    const auto same = [&](const IrradianceRecord& r) { return r.id == record.id && r.irradiance == record.irradiance; };
    const auto& records = before.integrator->cache().records();
    if (std::none_of(records.begin(), records.end(), same) || kept++ % 8 != 0) continue;
    old_values.push_back(irradiance_of(before, record, 50));
    new_values.push_back(irradiance_of(after, record, 60));
  }
  EXPECT_GT(old_values.size(), 10u);
  EXPECT_TRUE(all_agree(new_values, old_values, double{kTouchedPart}));
}

INSTANTIATE_TEST_SUITE_P(Of, IrradianceCacheUpdate, testing::ValuesIn(kChanges),
                         [](const auto& param) { return std::string(param.param.name); });

TEST(IrradianceCacheFile, ReadBackGivesTheSameImageWithoutAGatherRay) {
  const TempFolder folder;
  const JobSpec spec = spec_of(folder, 5);
  const Looked first({}, spec), second({}, spec);
  EXPECT_GT(first.integrator->figures().gather_rays, 10000u);
  EXPECT_EQ(second.integrator->figures().gather_rays, 0u);
  EXPECT_EQ(second.integrator->figures().kept, first.integrator->figures().records);
  EXPECT_EQ(layer_of(render(*first.integrator, 3)), layer_of(render(*second.integrator, 3)));
  // And that of a job that keeps nothing.
  JobSpec without = spec;
  without.cache.file.clear();
  const Looked third({}, without);
  EXPECT_EQ(layer_of(render(*first.integrator, 3)), layer_of(render(*third.integrator, 3)));
}

TEST(IrradianceCacheFile, ServesAnotherViewOfTheSameScene) {
  const TempFolder folder;
  const JobSpec spec = spec_of(folder, 5);
  Rooms rooms;
  const Looked first(rooms, spec);
  JobSpec closer = spec;
  closer.image = {.width = 20, .height = 20};
  const TempFolder elsewhere;
  JobSpec alone = closer;
  alone.folder = elsewhere.path();
  const Looked helped(rooms, closer), unhelped(rooms, alone);
  EXPECT_LT(helped.integrator->figures().gather_rays, unhelped.integrator->figures().gather_rays / 4);
  EXPECT_GT(helped.integrator->figures().records, first.integrator->figures().records);
  // The first view's records are still there, and no overture is due for either.
  EXPECT_EQ(Looked(rooms, spec).integrator->figures().gather_rays, 0u);
  EXPECT_EQ(Looked(rooms, closer).integrator->figures().gather_rays, 0u);
}

TEST(IrradianceCacheFile, OfOtherOptionsIsBuiltAnew) {
  const TempFolder folder;
  JobSpec spec = spec_of(folder, 5);
  const Looked first({}, spec);
  spec.irradiance_cache.rays = 64;
  const Looked second({}, spec);
  EXPECT_EQ(second.integrator->figures().kept, 0u);
  EXPECT_GT(second.integrator->figures().gathered, 100u);
}

TEST(IrradianceCacheFile, ThatIsNoneIsLeftAloneAndReported) {
  const TempFolder folder;
  const JobSpec spec = spec_of(folder, 5);
  const auto file = folder.path() / "records.cache";
  ASSERT_TRUE(write_file_atomically(file, "somebody's letter"));
  SceneMaker maker = Rooms().make();
  const auto scene = maker.build();
  const IrradianceCacheIntegrator integrator(*scene, scene->cameras().front(), spec, *scene_parts(maker.description));
  ASSERT_TRUE(integrator.file_error());
  EXPECT_NE(integrator.file_error()->message.find("byte 0: not an irradiance cache"), std::string::npos);
  EXPECT_GT(integrator.figures().records, 100u);
  EXPECT_EQ(*read_file(file, 100), "somebody's letter");
}

}  // namespace
}  // namespace pf::test
