#include "worker/integrators/ppm.h"

#include <gtest/gtest.h>

#include "common/base/memory.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"

namespace pf::test {
namespace {

JobSpec ppm_job(int width, int height, std::int64_t photons) {
  JobSpec spec = job(width, height, IntegratorType::kPpm, photons);
  spec.ppm.eye_samples = 4;
  return spec;
}

Statistics one_sub_pass(const Integrator& integrator, std::uint64_t index) {
  Statistics sums = Film(integrator.film_options()).sums();
  integrator.run({index, 1}, integrator.initial_radii(), sums);
  return sums;
}

TEST(Ppm, LooksAtTheSamePointsInEverySubPass) {
  const auto scene = peer_box(16).build();
  JobSpec spec = ppm_job(24, 16, 1000);
  // Features take one eye sample of a sub-pass after the other: those of sub-passes four apart are the same.
  const auto ppm = make_integrator(*scene, spec);
  EXPECT_EQ(one_sub_pass(*ppm, 1).features, one_sub_pass(*ppm, 5).features);
  EXPECT_NE(one_sub_pass(*ppm, 1).features, one_sub_pass(*ppm, 2).features);
  spec.integrator.type = IntegratorType::kSppm;
  const auto sppm = make_integrator(*scene, spec);
  EXPECT_NE(one_sub_pass(*sppm, 1).features, one_sub_pass(*sppm, 5).features);
}

TEST(Ppm, KeepsStatisticsForEveryHitPointOfSplitPaths) {
  const auto glass = peer_box(16).build();
  EXPECT_EQ(make_integrator(*glass, ppm_job(24, 16, 100))->film_options().hit_points, 8)
      << "glass splits paths: as many as allowed";
  const auto diffuse = diffuse_box().build();
  EXPECT_EQ(make_integrator(*diffuse, ppm_job(24, 16, 100))->film_options().hit_points, 4) << "one for each eye sample";
}

/// Both converge to the same picture where the eye sees no depth of field; the eye samples of each are its own.
TEST(Ppm, AgreesWithSppmAndSharingStatisticsChangesNothingInTheMean) {
  const auto scene = peer_box(24).build();
  constexpr int kRuns = 6;
  constexpr std::uint64_t kPasses = 24;
  constexpr double kBlur = 0.02;  // radii differ, and so does what they blur
  JobSpec spec = ppm_job(16, 16, 8000);
  spec.ppm.eye_samples = 16;
  spec.ppm.hit_points = 64;
  const auto ppm = Renders(*scene, spec, kPasses, kRuns).blocks(4, 4);
  spec.ppm.hit_points = 2;
  const auto sharing = Renders(*scene, spec, kPasses, kRuns).blocks(4, 4);
  spec.integrator.type = IntegratorType::kSppm;
  const auto sppm = Renders(*scene, spec, 4 * kPasses, kRuns).blocks(4, 4);
  EXPECT_TRUE(all_agree(ppm, sppm, kBlur, 0.002));
  EXPECT_TRUE(all_agree(sharing, sppm, kBlur, 0.002));
}

TEST(Ppm, NeedsNoMoreMemoryAfterAThousandPasses) {
  const auto scene = diffuse_box().build();
  const auto ppm = make_integrator(*scene, ppm_job(8, 8, 200));
  Film film(ppm->film_options());
  film.set_initial_radii(ppm->initial_radii());
  const auto run_to = [&](std::uint64_t passes) {
    while (film.sub_passes() < passes) {
      ppm->run({film.sub_passes(), 1}, film.state(), film.sums());
      film.close_round_if_complete();
    }
  };
  run_to(50);
  const std::uint64_t before = peak_resident_bytes();
  run_to(1000);
  EXPECT_LE(peak_resident_bytes(), before + (std::uint64_t{2} << 20));
}

}  // namespace
}  // namespace pf::test
