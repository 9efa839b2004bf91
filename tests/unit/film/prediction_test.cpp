#include "common/film/prediction.h"

#include <cmath>

#include <gtest/gtest.h>

namespace pf {
namespace {

/// A render whose passes all cost the same and whose error falls as passes^-exponent.
PilotRender ideal(double exponent) {
  PilotRender pilot;
  double before = 0;
  for (const double passes : {2.0, 4.0, 8.0, 16.0}) {
    pilot.points.push_back({passes, 0.5 * (passes - before), std::pow(passes, -exponent)});
    before = passes;
  }
  pilot.setup_seconds = 1;
  pilot.peak_bytes = 1000;
  pilot.result_bytes = 100;
  pilot.state_bytes = 10;
  pilot.scene_bytes = 1;
  return pilot;
}

TEST(Prediction, TimeIsSetupAndPasses) {
  const Prediction p = predict(ideal(0.5), {.passes = 100});
  EXPECT_DOUBLE_EQ(p.seconds.likely, 51);
  EXPECT_LT(p.seconds.low, 51);
  EXPECT_GT(p.seconds.high, 51);
  EXPECT_FALSE(p.passes_to_error);
}

TEST(Prediction, TheErrorsOwnSlopeIsTheLikelyOne) {
  const Prediction noise = predict(ideal(0.5), {.error = 0.01});
  ASSERT_TRUE(noise.passes_to_error);
  EXPECT_NEAR(noise.passes_to_error->likely, 10000, 1);
  EXPECT_NEAR(noise.passes_to_error->low, 10000, 1) << "nothing falls faster than noise";
  EXPECT_GT(noise.passes_to_error->high, 1e5);
  EXPECT_NEAR(noise.passes, 10000, 1);
  const Prediction slow = predict(ideal(1.0 / 3.0), {.error = 0.1});
  EXPECT_NEAR(slow.passes_to_error->likely, 1000, 2);
  EXPECT_LE(slow.passes_to_error->low, slow.passes_to_error->likely);
  const Prediction reached = predict(ideal(0.5), {.error = 1.0});
  EXPECT_LE(reached.passes_to_error->likely, 2) << "an error that the pilot has had already";
}

TEST(Prediction, AnUnknownErrorPredictsNone) {
  PilotRender pilot = ideal(0.5);
  for (PilotPoint& point : pilot.points) point.error = 0;
  const Prediction p = predict(pilot, {.error = 0.01});
  EXPECT_FALSE(p.passes_to_error);
}

TEST(Prediction, RoundsAndWorkersMakeTheTraffic) {
  const double one = predict(ideal(0.5), {.passes = 1000}).network_bytes.likely;
  const double ten = predict(ideal(0.5), {.passes = 1000, .workers = 10}).network_bytes.likely;
  EXPECT_GT(ten, 5 * one);
  EXPECT_LE(ten, 10 * one);
  const double longer = predict(ideal(0.5), {.passes = 8000}).network_bytes.likely;
  EXPECT_LT(longer, 2 * one) << "rounds grow: traffic grows with the logarithm";
  EXPECT_GT(longer, one);
}

}  // namespace
}  // namespace pf
