#include "common/film/metrics.h"

#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "tests/unit/film/formula_picture.h"

namespace pf {
namespace {

/// Computed with numpy 2.4.6 in double precision; the first, second and last as function `rel` of the
/// project's independent metrics.py does.
struct Expected {
  int width, height;
  double relative_mse, trimmed, mean_ratio, rmse, mae, smape, max_error;
};
constexpr Expected kExpected[] = {
    {48, 32, 1.26220236398795, 1.11088910951138, 1.09638953735144, 0.321995040377206, 0.176669650607639,
     0.13851840320605, 1.875},
    {64, 48, 0.919252012491989, 0.777345819503132, 1.0956327655974, 0.277997357865102, 0.138359705607096,
     0.136370189735422, 1.875},
};

TEST(Metrics, GiveWhatNumpyGives) {
  for (const Expected& e : kExpected) {
    const Picture picture = make_picture(e.width, e.height, true);
    const ErrorMetrics m = compare_pixels(picture.image, picture.reference);
    EXPECT_NEAR(m.relative_mse, e.relative_mse, 1e-12 * e.relative_mse);
    EXPECT_NEAR(m.relative_mse_trimmed, e.trimmed, 1e-12 * e.trimmed);
    EXPECT_NEAR(m.mean_ratio, e.mean_ratio, 1e-12);
    EXPECT_NEAR(m.rmse, e.rmse, 1e-12);
    EXPECT_NEAR(m.mae, e.mae, 1e-12);
    EXPECT_NEAR(m.smape, e.smape, 1e-12);
    EXPECT_EQ(m.max_error, e.max_error);
    EXPECT_EQ(m.pixels, picture.image.size());
    EXPECT_TRUE(m.finite());
  }
}

TEST(Metrics, OfEqualImagesAreZero) {
  const Picture picture = make_picture(20, 10, true);
  const ErrorMetrics m = compare_pixels(picture.image, picture.image);
  EXPECT_EQ(m.relative_mse, 0.0);
  EXPECT_EQ(m.relative_mse_trimmed, 0.0);
  EXPECT_EQ(m.rmse, 0.0);
  EXPECT_EQ(m.smape, 0.0);
  EXPECT_EQ(m.max_error, 0.0);
  EXPECT_EQ(m.mean_ratio, 1.0);
}

TEST(Metrics, FollowTheirDefinitionsOnOnePixel) {
  const std::vector<Rgb> image = {{2.0f, 0.0f, -1.0f}};
  const std::vector<Rgb> reference = {{1.0f, 0.0f, 1.0f}};
  const ErrorMetrics m = compare_pixels(image, reference);
  EXPECT_DOUBLE_EQ(m.relative_mse, (1.0 / 1.01 + 0.0 + 4.0 / 1.01) / 3.0);
  EXPECT_DOUBLE_EQ(m.relative_mse_trimmed, m.relative_mse);  // the only pixel stays
  EXPECT_DOUBLE_EQ(m.rmse, std::sqrt(5.0 / 3.0));
  EXPECT_DOUBLE_EQ(m.mae, 1.0);
  EXPECT_DOUBLE_EQ(m.smape, (1.0 / 3.01 + 2.0 / 2.01) / 3.0);
  EXPECT_DOUBLE_EQ(m.max_error, 2.0);
  EXPECT_DOUBLE_EQ(m.mean_ratio, 0.5);
  EXPECT_EQ(m.image.negative, 1u);
  EXPECT_EQ(m.reference.negative, 0u);
}

TEST(Metrics, TrimLeavesOutTheWorstPixelInAThousandRoundedUp) {
  for (const std::size_t pixels : {999u, 1000u, 1001u, 2000u}) {
    std::vector<Rgb> image(pixels, Rgb(1.0f));
    const std::vector<Rgb> reference(pixels, Rgb(1.0f));
    image[3] = Rgb(100.0f);
    EXPECT_EQ(compare_pixels(image, reference).relative_mse_trimmed, 0.0);
    image[5] = Rgb(50.0f);
    EXPECT_EQ(compare_pixels(image, reference).relative_mse_trimmed == 0.0, pixels > 1000) << pixels;
  }
}

TEST(Metrics, CountNonFinitePixelsAndGiveNoFigureThen) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  std::vector<Rgb> image(6, Rgb(0.5f));
  const std::vector<Rgb> reference(6, Rgb(0.5f));
  image[2] = {0.0f, nan, inf};
  image[4] = {-inf, 0.0f, 0.0f};
  const ErrorMetrics m = compare_pixels(image, reference);
  EXPECT_FALSE(m.finite());
  EXPECT_EQ(m.image.nonfinite, 2u);
  EXPECT_EQ(m.image.first_nonfinite, 2u);
  EXPECT_EQ(m.image.negative, 1u);
  EXPECT_EQ(m.reference.nonfinite, 0u);
  for (const double figure :
       {m.relative_mse, m.relative_mse_trimmed, m.rmse, m.mae, m.smape, m.max_error, m.mean_ratio}) {
    EXPECT_TRUE(std::isnan(figure));
  }
  EXPECT_FALSE(compare_pixels(reference, image).finite());
}

TEST(Metrics, OfImagesOfOtherSizesOrOfNothingAreNotFigures) {
  const std::vector<Rgb> one(1, Rgb(1.0f));
  EXPECT_TRUE(std::isnan(compare_pixels(one, {}).relative_mse));
  EXPECT_TRUE(std::isnan(compare_pixels({}, {}).relative_mse));
}

}  // namespace
}  // namespace pf
