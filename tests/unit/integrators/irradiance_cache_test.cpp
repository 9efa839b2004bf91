// What the image of irradiance caching depends on, and what its records cost.

#include <gtest/gtest.h>

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <set>
#include <vector>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/integrators/irradiance_cache.h"

namespace pf::test {
namespace {

JobSpec small_cache(int width = 32, int height = 24) {
  JobSpec spec = job(width, height, IntegratorType::kIrradianceCache);
  spec.irradiance_cache.source = GatherSource::kPath;
  spec.irradiance_cache.rays = 64;
  spec.photon_map.caustic_photons = 1000;
  return spec;
}

std::unique_ptr<const IrradianceCacheIntegrator> look(const Scene& scene, const JobSpec& spec) {
  return std::make_unique<IrradianceCacheIntegrator>(scene, scene.cameras().front(), spec);
}

TEST(IrradianceCaching, GivesTheSameBitsOnOneTwoAndFiveThreads) {
  const auto scene = peer_box(16).build();
  std::vector<Rgb> one;
  for (const int threads : {1, 2, 5}) {
    const tbb::global_control allowed(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    std::vector<Rgb> image;
    arena.execute([&] { image = layer_of(render(*look(*scene, small_cache()), 3)); });
    if (threads == 1) one = image;
    ASSERT_EQ(image.size(), one.size());
    EXPECT_EQ(std::memcmp(image.data(), one.data(), one.size() * sizeof(Rgb)), 0) << threads;
  }
}

TEST(IrradianceCaching, AddsUpToTheSameSumsHoweverUnitsAreCut) {
  const auto scene = diffuse_box().build();
  const auto integrator = look(*scene, small_cache());
  const auto sums = [&](std::vector<WorkUnit> units) {
    Statistics all(32, 24, true, true);
    for (const WorkUnit& unit : units) integrator->run(unit, {}, all);
    return all;
  };
  const std::uint64_t passes = PassOrder(integrator->film_options()).sub_passes(2);
  const Statistics whole = sums({{0, passes}}),
                   cut = sums({{passes / 2, passes - passes / 2}, {0, 1}, {1, passes / 2 - 1}});
  EXPECT_EQ(whole.pixels, cut.pixels);
  EXPECT_EQ(whole.extras, cut.extras);
  EXPECT_EQ(whole.features, cut.features);
  EXPECT_EQ(whole.rays, cut.rays);
}

TEST(IrradianceCaching, MarksEveryRecordItMadeOnce) {
  const auto scene = diffuse_box().build();
  const auto integrator = look(*scene, small_cache());
  const Film film = render(*integrator, 2);
  std::int64_t marks = 0;
  for (const ExtraSums& extra : film.sums().extras) marks += extra.marks;
  EXPECT_EQ(static_cast<std::uint64_t>(marks), integrator->figures().records);
  EXPECT_EQ(integrator->figures().gathered, integrator->figures().records);
  std::uint64_t rays = 0;
  for (const IrradianceRecord& record : integrator->cache().records()) rays += record.grid().cells();
  EXPECT_EQ(integrator->figures().gather_rays, rays);
}

TEST(IrradianceCaching, GivesRecordsRaysByThePixelsThatTheyServe) {
  const auto scene = diffuse_box().build();
  JobSpec spec = small_cache(64, 64);
  spec.irradiance_cache.rays = 256;
  spec.irradiance_cache.max_spacing = 32.0;
  const auto integrator = look(*scene, spec);
  std::set<std::uint32_t> rays;
  for (const IrradianceRecord& record : integrator->cache().records()) rays.insert(record.rays);
  // Lattices of 32, 16, 8, 4 and 2 pixels.
  EXPECT_EQ(rays, (std::set<std::uint32_t>{512, 256, 128, 64, 32}));
}

TEST(IrradianceCaching, LeavesFewSamplesWithoutARecord) {
  const auto scene = diffuse_box().build();
  const auto integrator = look(*scene, small_cache(64, 64));
  static_cast<void>(render(*integrator, 16));
  // Samples that the overture has not seen: antialiased edges, and what a radius that shrank later no longer
  // covers.
  EXPECT_LT(static_cast<double>(integrator->misses()), 0.02 * 16 * 64 * 64);
}

TEST(IrradianceCaching, PutsRecordsIntoCornersRatherThanOntoWalls) {
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.lambert({0.5f, 0.5f, 0.5f}), true);
  maker.quad({-0.5f, 0.99f, -0.5f}, {1, 0, 0}, {0, 0, 1}, maker.emitter({5, 5, 5}));
  maker.camera({0, 0, 0.95f}, {0, 0, -1}, 1.2f);
  const auto scene = maker.build();
  JobSpec spec = small_cache(96, 96);
  spec.irradiance_cache.rays = 256;
  std::array<int, 2> placed{};
  const auto integrator = look(*scene, spec);
  for (const IrradianceRecord& record : integrator->cache().records()) {
    // On the far wall, by the distance to its nearest edge: the outer ring has the area of the inner square.
    if (record.normal.z < 0.99f || record.position.z > -0.99f) continue;
    const float off = std::max(std::abs(record.position.x), std::abs(record.position.y));
    ++placed[off > 0.70710678f ? 1 : 0];
  }
  EXPECT_GT(placed[0], 5);
  EXPECT_GT(placed[1], 2 * placed[0]);
}

TEST(IrradianceCaching, SpacesRecordsBetweenItsBoundsInPixels) {
  const auto scene = diffuse_box().build();
  std::uint64_t before = ~0ull;
  for (const double spacing : {1.0, 4.0, 12.0}) {
    JobSpec spec = small_cache(64, 64);
    spec.irradiance_cache.min_spacing = spacing;
    const std::uint64_t records = look(*scene, spec)->figures().records;
    EXPECT_LT(records, before);
    before = records;
  }
  JobSpec tight = small_cache(64, 64), wide = tight;
  tight.irradiance_cache.max_spacing = 3.0;
  wide.irradiance_cache.error = tight.irradiance_cache.error = 0.5;
  EXPECT_GT(look(*scene, tight)->figures().records, 2 * look(*scene, wide)->figures().records);
}

}  // namespace
}  // namespace pf::test
