// A picture's bits may depend on the job and the scene alone: not on threads, nor on how the work was cut or
// merged.

#include <cstring>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_tracer.h"

namespace pf::test {
namespace {

JobSpec small(IntegratorType type, ProgressiveMode mode = ProgressiveMode::kShared) {
  JobSpec spec = job(40, 24, type, 20000);
  spec.integrator.mode = mode;
  spec.photon_map.caustic_photons = 20000;
  spec.final_gather.rays = 32;
  spec.irradiance_cache.rays = 32;
  return spec;
}

testing::AssertionResult same_sums(const Statistics& a, const Statistics& b) {
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    if (a.pixels[i] != b.pixels[i] || a.features[i] != b.features[i] ||
        (!a.extras.empty() && a.extras[i] != b.extras[i])) {
      return testing::AssertionFailure() << "pixel " << i << " differs";
    }
  }
  if (a.sub_passes != b.sub_passes || a.photon_paths != b.photon_paths || a.photons_stored != b.photons_stored ||
      a.rays != b.rays) {
    return testing::AssertionFailure() << "figures differ";
  }
  return testing::AssertionSuccess();
}

Statistics empty_sums(const Integrator& integrator) { return Film(integrator.film_options()).sums(); }

template <typename F>
void on_threads(int threads, F&& work) {
  const tbb::global_control allowed(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  arena.execute(work);
}

testing::AssertionResult same_bytes(const std::vector<Rgb>& a, const std::vector<Rgb>& b) {
  if (a.size() != b.size() || std::memcmp(a.data(), b.data(), a.size() * sizeof(Rgb)) != 0) {
    return testing::AssertionFailure() << "images differ";
  }
  return testing::AssertionSuccess();
}

class Determinism : public testing::TestWithParam<std::pair<IntegratorType, ProgressiveMode>> {
 protected:
  JobSpec spec_ = small(GetParam().first, GetParam().second);
  std::unique_ptr<const Scene> scene_ = peer_box(24).build();
};

TEST_P(Determinism, OneTwoAndFiveThreadsGiveTheSameImage) {
  std::vector<Rgb> one;
  on_threads(1, [&] { one = layer_of(render(*scene_, spec_, 4)); });
  for (const int threads : {2, 5}) {
    on_threads(threads, [&] { EXPECT_TRUE(same_bytes(layer_of(render(*scene_, spec_, 4)), one)) << threads; });
  }
}

TEST_P(Determinism, AUnitCutInTwoGivesTheSameSums) {
  const auto integrator = make_integrator(*scene_, spec_);
  const auto radii = integrator->initial_radii();
  Statistics whole = empty_sums(*integrator), parts = whole;
  integrator->run({3, 5}, radii, whole);
  integrator->run({3, 2}, radii, parts);
  integrator->run({5, 3}, radii, parts);
  EXPECT_TRUE(same_sums(whole, parts));
}

TEST_P(Determinism, ResultsMergedInAnyOrderGiveTheSameSums) {
  const auto integrator = make_integrator(*scene_, spec_);
  const auto radii = integrator->initial_radii();
  std::vector<Statistics> units(3, empty_sums(*integrator));
  integrator->run({0, 1}, radii, units[0]);
  integrator->run({1, 2}, radii, units[1]);
  integrator->run({3, 1}, radii, units[2]);
  Statistics forwards = empty_sums(*integrator), backwards = forwards, whole = forwards;
  for (const int i : {0, 1, 2}) ASSERT_TRUE(forwards.add(units[static_cast<std::size_t>(i)]));
  for (const int i : {2, 0, 1}) ASSERT_TRUE(backwards.add(units[static_cast<std::size_t>(i)]));
  integrator->run({0, 4}, radii, whole);
  EXPECT_TRUE(same_sums(forwards, backwards));
  EXPECT_TRUE(same_sums(forwards, whole));
}

TEST_P(Determinism, AnotherSeedGivesAnotherImage) {
  JobSpec other = spec_;
  other.integrator.seed = 2;
  EXPECT_FALSE(same_bytes(layer_of(render(*scene_, spec_, 1)), layer_of(render(*scene_, other, 1))));
}

INSTANTIATE_TEST_SUITE_P(Algorithms, Determinism,
                         testing::Values(std::pair{IntegratorType::kPath, ProgressiveMode::kShared},
                                         std::pair{IntegratorType::kSppm, ProgressiveMode::kShared},
                                         std::pair{IntegratorType::kSppm, ProgressiveMode::kIndependent},
                                         std::pair{IntegratorType::kPpm, ProgressiveMode::kShared},
                                         std::pair{IntegratorType::kPpm, ProgressiveMode::kIndependent},
                                         std::pair{IntegratorType::kPhotonMap, ProgressiveMode::kShared},
                                         std::pair{IntegratorType::kFinalGather, ProgressiveMode::kShared},
                                         std::pair{IntegratorType::kIrradianceCache, ProgressiveMode::kShared},
                                         std::pair{IntegratorType::kPhotonSplat, ProgressiveMode::kShared}),
                         [](const auto& param) {
                           return fmt::format("{}_{}", to_string(param.param.first), to_string(param.param.second));
                         });

TEST(PhotonTracer, GivesTheSamePhotonsInTheSameOrderOnAnyNumberOfThreads) {
  const auto scene = peer_box(24).build();
  const PhotonTracer tracer(*scene, {5, 50000, 32});
  PhotonBatch one;
  on_threads(1, [&] { one = tracer.trace(2); });
  ASSERT_GT(one.flows[kCaustic].size(), 100u);
  ASSERT_GT(one.flows[kIndirect].size(), 1000u);
  for (const int threads : {2, 5}) {
    PhotonBatch many;
    on_threads(threads, [&] { many = tracer.trace(2); });
    EXPECT_EQ(many.rays, one.rays);
    for (const Flow flow : {kCaustic, kIndirect}) {
      EXPECT_EQ(many.flows[flow], one.flows[flow]);
    }
  }
}

}  // namespace
}  // namespace pf::test
