#include "jobs/benchmark/statistics.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace pf::bench {
namespace {

using Images = std::vector<std::vector<Rgb>>;

TEST(BenchStatistics, TheParetoFrontIsWhatNothingBeats) {
  std::mt19937_64 random(1);
  std::vector<Point> points;
  for (int i = 0; i < 200; ++i) {
    points.push_back({static_cast<double>(random() % 40), static_cast<double>(random() % 40)});  // with equal ones
  }
  points.push_back({std::nan(""), 0});
  const std::vector<std::size_t> front = pareto_front(points);
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    bool beaten = false;
    for (std::size_t j = 0; j + 1 < points.size(); ++j) {
      const bool no_worse = points[j].x <= points[i].x && points[j].y <= points[i].y;
      const bool better = points[j].x < points[i].x || points[j].y < points[i].y;
      beaten = beaten || (no_worse && (better || j < i));
    }
    EXPECT_EQ(std::find(front.begin(), front.end(), i) != front.end(), !beaten) << i;
  }
  for (std::size_t k = 1; k < front.size(); ++k) EXPECT_LT(points[front[k - 1]].x, points[front[k]].x);
}

TEST(BenchStatistics, AFitHasTheIntervalOfTextbooks) {
  // Anscombe's first quartet (1973): slope 0.5001, standard error 0.1179, intercept 3.0001, 11 points.
  const std::vector<Point> points = {{10, 8.04}, {8, 6.95}, {13, 7.58},  {9, 8.81}, {11, 8.33}, {14, 9.96},
                                     {6, 7.24},  {4, 4.26}, {12, 10.84}, {7, 4.82}, {5, 5.68}};
  const auto fit = fit_line(points);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->slope, 0.5001, 1e-4);
  EXPECT_NEAR(fit->intercept, 3.0001, 1e-4);
  EXPECT_NEAR(fit->high - fit->slope, 2.262 * 0.1179, 3e-4);
  EXPECT_FALSE(fit_line(std::vector<Point>{{1, 1}, {1, 2}}));
  EXPECT_TRUE(std::isinf(fit_line(std::vector<Point>{{1, 1}, {2, 2}})->high));
}

TEST(BenchStatistics, StudentsQuantilesMatchTheTables) {
  EXPECT_NEAR(student_t_95(1), 12.706, 1e-3);
  EXPECT_NEAR(student_t_95(40), 2.021, 1e-3);
  EXPECT_NEAR(student_t_95(120), 1.980, 1e-3);
}

TEST(BenchStatistics, TheSlopeOfRunsHasAnIntervalFromTheRuns) {
  std::vector<std::vector<Point>> runs;
  for (const double slope : {-0.9, -1.0, -1.1}) {
    runs.emplace_back();
    for (const double x : {1.0, 2.0, 4.0, 8.0}) runs.back().push_back({x, 0.1 * std::pow(x, slope)});
    runs.back().push_back({16, -1});  // below zero: left out
  }
  const auto fit = fit_slope(runs);
  ASSERT_TRUE(fit);
  EXPECT_TRUE(fit->from_runs);
  EXPECT_NEAR(fit->line.slope, -1.0, 1e-12);
  EXPECT_NEAR(fit->line.high + 1.0, 4.303 * 0.1 / std::sqrt(3.0), 1e-3);
  EXPECT_NEAR(std::pow(10, fit->line.intercept), 0.1, 1e-9);
  EXPECT_EQ(fit->line.points, 12);
  runs.pop_back();
  EXPECT_FALSE(fit_slope(runs)->from_runs);
  EXPECT_FALSE(fit_slope({}));
}

TEST(BenchStatistics, TimeToAnErrorIsInterpolatedInLogarithms) {
  using Kind = TimeToError::Kind;
  const std::vector<Point> curve = {{1, 1e-1}, {10, 1e-2}, {100, 1e-4}};
  EXPECT_EQ(time_to_error(curve, 0.2).kind, Kind::kBeforeFirst);
  const TimeToError reached = time_to_error(curve, 1e-3);
  EXPECT_EQ(reached.kind, Kind::kReached);
  EXPECT_NEAR(reached.seconds, std::pow(10, 1.5), 1e-9);
  EXPECT_EQ(time_to_error(curve, 1e-5).kind, Kind::kNotReached);
  EXPECT_EQ(time_to_error(curve, 1e-5).seconds, 100);
  EXPECT_EQ(time_to_error({}, 1).kind, Kind::kNotReached);
}

/// Images of `pixels` values around `mean`, independent noise of this standard deviation.
std::vector<Rgb> noisy(std::size_t pixels, double mean, double deviation, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(mean, deviation);
  std::vector<Rgb> image(pixels);
  for (Rgb& p : image) {
    for (int c = 0; c < 3; ++c) p[c] = static_cast<float>(normal(random));
  }
  return image;
}

TEST(BenchStatistics, BiasAndVarianceComeApartAlsoAgainstANoisyReference) {
  constexpr std::size_t kPixels = 20000;
  const Halves reference = join_halves(noisy(kPixels, 1.0, 0.2, 101), noisy(kPixels, 1.0, 0.2, 102));
  Images images;
  for (std::uint64_t s = 0; s < 4; ++s) images.push_back(noisy(kPixels, 1.1, 0.3, s));
  const auto parts = error_parts(images, reference.mean, reference.variance, false);
  ASSERT_TRUE(parts);
  // Truth: bias2 0.01, variance 0.09. Standard errors: about 0.3 sqrt(2/(3 x 60000)) and 2 x 0.1 x 0.2 / sqrt(60000).
  EXPECT_NEAR(parts->variance, 0.09, 0.0012);
  EXPECT_NEAR(parts->bias2, 0.01, 0.0015);
  EXPECT_NEAR(parts->mse, 0.10, 0.002);
  EXPECT_LT(parts->bias2_error, 0.0015);
  EXPECT_GT(parts->bias2_error, 0.0001);
  EXPECT_NEAR(reference.noise, 0.02 / 1.01 * 1.06,
              0.0006);  // E[1/r^2] is 1 + 3 x 0.02 for the noisy r that it is divided by
  const auto naive = error_parts(images, reference.mean, {}, false);
  EXPECT_NEAR(naive->bias2 - parts->bias2, 0.02, 0.0005);  // the reference's variance, which is taken off
  const auto relative = error_parts(images, std::vector<Rgb>(kPixels, Rgb{1, 1, 1}), {}, true);
  EXPECT_NEAR(relative->variance, 0.09 / 1.01, 0.0012);
}

TEST(BenchStatistics, BiasOfNothingMayComeOutBelowZero) {
  int below = 0;
  for (std::uint64_t s = 0; s < 40; ++s) {
    const Images images = {noisy(50, 0, 1, 2 * s), noisy(50, 0, 1, 2 * s + 1)};
    const auto parts = error_parts(images, std::vector<Rgb>(50, Rgb{0, 0, 0}), {}, false);
    below += parts->bias2 < 0 ? 1 : 0;
    EXPECT_TRUE(std::isinf(parts->bias2_error));
  }
  EXPECT_GT(below, 8);
  EXPECT_LT(below, 36);
  EXPECT_FALSE(error_parts(Images{noisy(5, 0, 1, 1)}, noisy(5, 0, 1, 2), {}, false));
  EXPECT_FALSE(error_parts(Images{noisy(5, 0, 1, 1), noisy(6, 0, 1, 1)}, noisy(5, 0, 1, 2), {}, false));
}

}  // namespace
}  // namespace pf::bench
