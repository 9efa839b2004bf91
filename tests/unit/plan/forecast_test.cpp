#include "worker/plan/forecast.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/scenes.h"

namespace pf::test {
namespace {

TEST(Forecast, TakesAsManyPassesAsTheErrorNeeds) {
  const Forecast noise{.fast = 1.0, .pass = 2.0};
  EXPECT_EQ(noise.passes_to(0.01), 100);
  EXPECT_EQ(noise.work_to(0.01), 200);
  const Forecast photons{.slow = 1.0};
  EXPECT_NEAR(photons.passes_to(0.01), 1000, 2);
  EXPECT_EQ(noise.passes_to(2.0), 1);
}

TEST(Forecast, IsJudgedByAFirstLookAndByAFineImage) {
  const Forecast noise{.fast = 1.0, .setup = 10.0, .pass = 1.0};
  EXPECT_DOUBLE_EQ(noise.judged_work(), std::sqrt(110.0 * 1010.0));
  const Forecast good_at_first{.fast = 0.1, .floor = 0.002, .pass = 1.0};
  EXPECT_TRUE(std::isinf(good_at_first.judged_work()));
}

TEST(Forecast, NeverGetsBelowItsFloor) {
  const Forecast f{.fast = 1.0, .floor = 0.02};
  EXPECT_TRUE(std::isinf(f.passes_to(0.01)));
  EXPECT_EQ(f.passes_to(0.03), 100);
}

TEST(Forecast, MissedLightOfADeltaLampStaysMissed) {
  Pilot pilot;
  pilot.delta_flux = 1;
  pilot.light[kCaustic] = 1;
  pilot.caustic_square = 0.5;
  const JobSpec spec = job(64, 48, IntegratorType::kAuto, 0);
  EXPECT_EQ(forecast_path(spec, pilot).floor, 0.5);
  pilot.path_light[kCaustic] = 1;
  EXPECT_EQ(forecast_path(spec, pilot).floor, 0);
}

TEST(Forecast, MissedLightOfASmallLampIsNoise) {
  Pilot pilot;
  pilot.lamp_radiance = 1000;
  pilot.light[kCaustic] = 1;
  pilot.caustic_moment = 0.2;
  const Forecast f = forecast_path(job(64, 48, IntegratorType::kAuto, 0), pilot);
  EXPECT_EQ(f.floor, 0);
  EXPECT_EQ(f.fast, 200);
}

TEST(Forecast, MorePhotonsMakeAPassDearerInProportion) {
  Pilot pilot;
  pilot.photon_rays = 2;
  const double one = forecast_sppm(job(64, 48, IntegratorType::kSppm, 10000), pilot).pass;
  EXPECT_DOUBLE_EQ(forecast_sppm(job(64, 48, IntegratorType::kSppm, 30000), pilot).pass, 3 * one);
}

TEST(Forecast, PlansPhotonsByPixelsWithinBounds) {
  const Pilot pilot;
  const auto photons = [&](int width, int height, std::int64_t asked = 0) {
    return plan_sppm(job(width, height, IntegratorType::kAuto, asked), pilot).photons;
  };
  EXPECT_EQ(photons(320, 240), 4 * 320 * 240);
  EXPECT_EQ(photons(16, 16), 50'000);
  EXPECT_EQ(photons(1920, 1080), kMostPhotonPaths);
  EXPECT_EQ(photons(320, 240, 1234), 1234);
}

}  // namespace
}  // namespace pf::test
