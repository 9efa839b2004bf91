#include "common/film/flip.h"

#include <algorithm>
#include <chrono>
#include <limits>

#include <gtest/gtest.h>

#include "tests/unit/film/formula_picture.h"

namespace pf {
namespace {

/// What the authors' implementation gives for make_picture: PyPI flip-evaluator 1.7 (numpy 2.4.6, linear
/// input), map averaged in double precision. `center` is the error at (width / 2, height / 2).
struct Published {
  int width, height;
  float pixels_per_degree;
  double mean, largest, center;
  float start_exposure, stop_exposure;
  int exposures;
};
constexpr float kDefault = kPixelsPerDegree;
constexpr Published kLdr[] = {
    {48, 32, kDefault, 0.186601106, 0.450878531, 0.166029468, 0, 0, 0},
    {48, 32, 40.0f, 0.218667742, 0.540160537, 0.178408474, 0, 0, 0},
    {33, 21, kDefault, 0.186842851, 0.450868726, 0.192239076, 0, 0, 0},
    {33, 21, 40.0f, 0.217686953, 0.540160537, 0.218212888, 0, 0, 0},
    {1, 7, kDefault, 0.168792147, 0.229432091, 0.177345678, 0, 0, 0},
    {1, 7, 40.0f, 0.238225088, 0.338613957, 0.299816608, 0, 0, 0},
};
constexpr Published kHdr[] = {
    {48, 32, kDefault, 0.246360095, 0.821318865, 0.172863647, -1.439863324f, 2.125456810f, 4},
    {48, 32, 40.0f, 0.294589811, 0.973812342, 0.198100775, -1.439863324f, 2.125456810f, 4},
    {33, 21, kDefault, 0.246558483, 0.744837284, 0.198078498, -0.338128090f, 3.060183764f, 4},
    {33, 21, 40.0f, 0.298052730, 0.915265024, 0.293071061, -0.338128090f, 3.060183764f, 4},
    {1, 7, kDefault, 0.256252251, 0.431256950, 0.139436111, 3.783525229f, 4.786105633f, 2},
    {1, 7, 40.0f, 0.283871067, 0.616661787, 0.193181485, 3.783525229f, 4.786105633f, 2},
};
constexpr double kTolerance = 2e-6;  // absolute, of errors in [0, 1]

void expect_published(const FlipMap& map, const Published& p) {
  SCOPED_TRACE(testing::Message() << p.width << "x" << p.height << " at " << p.pixels_per_degree << " per degree");
  ASSERT_EQ(map.error.size(), static_cast<std::size_t>(p.width * p.height));
  EXPECT_NEAR(map.mean, p.mean, kTolerance);
  EXPECT_NEAR(*std::max_element(map.error.begin(), map.error.end()), p.largest, kTolerance);
  EXPECT_NEAR(map.error[p.height / 2 * p.width + p.width / 2], p.center, kTolerance);
}

TEST(Flip, LdrGivesTheValuesOfItsAuthorsImplementation) {
  for (const Published& p : kLdr) {
    const Picture picture = make_picture(p.width, p.height, false);
    expect_published(ldr_flip(picture.image, picture.reference, p.width, p.height, p.pixels_per_degree), p);
  }
}

TEST(Flip, HdrGivesTheValuesAndExposuresOfItsAuthorsImplementation) {
  for (const Published& p : kHdr) {
    const Picture picture = make_picture(p.width, p.height, true);
    const HdrFlipMap map = hdr_flip(picture.image, picture.reference, p.width, p.height, p.pixels_per_degree);
    expect_published(map, p);
    EXPECT_NEAR(map.start_exposure, p.start_exposure, 1e-5);
    EXPECT_NEAR(map.stop_exposure, p.stop_exposure, 1e-5);
    EXPECT_EQ(map.exposures, p.exposures);
  }
}

TEST(Flip, IsZeroForEqualImages) {
  const Picture picture = make_picture(40, 30, true);
  for (const float error : hdr_flip(picture.image, picture.image, 40, 30).error) EXPECT_EQ(error, 0.0f);
  for (const float error : ldr_flip(picture.image, picture.image, 40, 30).error) EXPECT_EQ(error, 0.0f);
}

TEST(Flip, LdrDoesNotDependOnTheOrderOfTheImages) {
  const Picture picture = make_picture(40, 30, false);
  EXPECT_EQ(ldr_flip(picture.image, picture.reference, 40, 30).error,
            ldr_flip(picture.reference, picture.image, 40, 30).error);
}

TEST(Flip, LdrClampsWhatADisplayCannotShow) {
  Picture picture = make_picture(16, 16, false);
  const std::vector<float> before = ldr_flip(picture.image, picture.reference, 16, 16).error;
  for (std::vector<Rgb>* image : {&picture.image, &picture.reference}) {
    for (Rgb& c : *image) {
      if (c.x == 1.0f) c.x = 7.0f;
      if (c.x == 0.0f) c.x = -3.0f;
    }
  }
  EXPECT_EQ(ldr_flip(picture.image, picture.reference, 16, 16).error, before);
}

TEST(Flip, HdrStaysFiniteForExtremeImages) {
  const std::vector<Rgb> black(64, Rgb(0.0f));
  std::vector<Rgb> bright(64, Rgb(0.0f));
  bright[9] = Rgb(1e38f, 3e-40f, -1e38f);
  const std::vector<Rgb> mostly_negative(64, Rgb(-1.0f));
  for (const auto& image : {black, bright, mostly_negative}) {
    for (const auto& reference : {black, bright, mostly_negative}) {
      const HdrFlipMap map = hdr_flip(image, reference, 8, 8);
      EXPECT_LE(map.exposures, 160);
      for (const float error : map.error) EXPECT_TRUE(error >= 0.0f && error <= 1.0f) << error;
    }
  }
  EXPECT_EQ(hdr_flip(black, black, 8, 8).mean, 0.0);
  EXPECT_EQ(hdr_flip(mostly_negative, black, 8, 8).mean, 0.0);
  EXPECT_GT(hdr_flip(bright, black, 8, 8).error[9], 0.5f);
  EXPECT_TRUE(hdr_flip({}, {}, 0, 0).error.empty());
}

TEST(Flip, HdrOfAnImageTakesSeconds) {
  const Picture picture = make_picture(640, 480, true);
  const auto start = std::chrono::steady_clock::now();
  const HdrFlipMap map = hdr_flip(picture.image, picture.reference, 640, 480);
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
  RecordProperty("seconds", std::to_string(seconds.count()));
  EXPECT_EQ(map.exposures, 4);
  EXPECT_LT(seconds.count(), 60.0);  // generous: sanitizers and a busy machine; about 0.6 s alone
}

TEST(Flip, MagmaRunsFromBlackOverPurpleToPaleYellow) {
  // From matplotlib's table; the polynomial that stands for it is within 6 of 255.
  const std::vector<float> error = {
      0.0f, 0.20405f, 0.43186f, 1.0f, 7.0f, -1.0f, std::numeric_limits<float>::quiet_NaN()};
  const std::vector<int> expected = {0,   0,   4,   61,  15, 113, 153, 45,  128, 252, 253,
                                     191, 252, 253, 191, 0,  0,   4,   252, 253, 191};
  const std::vector<std::uint8_t> colors = magma_colors(error);
  ASSERT_EQ(colors.size(), expected.size());
  for (std::size_t i = 0; i < colors.size(); ++i) EXPECT_NEAR(colors[i], expected[i], 6) << i;
}

}  // namespace
}  // namespace pf
