#include "common/math/distribution.h"

#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "common/math/philox.h"

namespace pf {
namespace {

TEST(Distribution1D, PicksInProportionToTheWeights) {
  const std::vector<float> weights = {1.0f, 0.0f, 3.0f, 0.0f, 4.0f};
  const Distribution1D distribution(weights);
  EXPECT_DOUBLE_EQ(distribution.total(), 8.0);
  std::vector<int> counts(weights.size(), 0);
  constexpr int kSteps = 8000;
  for (int i = 0; i < kSteps; ++i) {
    const auto pick = distribution.sample((static_cast<float>(i) + 0.5f) / kSteps);
    ASSERT_TRUE(pick);
    ++counts[pick->index];
    EXPECT_FLOAT_EQ(pick->probability, weights[pick->index] / 8.0f);
    EXPECT_FLOAT_EQ(pick->probability, distribution.probability(pick->index));
    EXPECT_GE(pick->u, 0.0f);
    EXPECT_LT(pick->u, 1.0f);
  }
  EXPECT_EQ(counts, (std::vector<int>{1000, 0, 3000, 0, 4000}));
}

TEST(Distribution1D, StretchesTheRestOfTheNumberOverTheItem) {
  const Distribution1D distribution(std::vector<float>{1.0f, 3.0f});
  EXPECT_NEAR(distribution.sample(0.125f)->u, 0.5f, 1e-6f);
  EXPECT_NEAR(distribution.sample(0.25f)->u, 0.0f, 1e-6f);
  EXPECT_NEAR(distribution.sample(0.625f)->u, 0.5f, 1e-6f);
}

TEST(Distribution1D, NeverPicksWhatHasNoWeightEvenAtTheEnds) {
  const Distribution1D distribution(std::vector<float>{0.0f, 2.0f, 0.0f, 0.0f});
  for (const float u : {0.0f, 1e-30f, 0.5f, 0x1.fffffep-1f, 1.0f}) EXPECT_EQ(distribution.sample(u)->index, 1u);
}

TEST(Distribution1D, TakesNegativeAndNonFiniteWeightsAsZeroAndIsEmptyWithoutAny) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(Distribution1D(std::vector<float>{nan, kInfinity, -1.0f, 5.0f}).sample(0.1f)->index, 3u);
  EXPECT_FALSE(Distribution1D(std::vector<float>{0.0f, nan}).sample(0.5f));
  EXPECT_FALSE(Distribution1D().sample(0.5f));
  EXPECT_EQ(Distribution1D(std::vector<float>{0.0f}).probability(0), 0.0f);
}

TEST(Distribution2D, SamplesAndProbabilitiesAgreeWithTheWeights) {
  constexpr std::size_t kWidth = 7, kHeight = 5;
  std::vector<float> weights(kWidth * kHeight);
  PathRng rng(1, Stream::kTest, 0, 0);
  double sum = 0.0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    weights[i] = i / kWidth == 2 || i % 6 == 1 ? 0.0f : rng.next1();  // row 2 is empty
    sum += static_cast<double>(weights[i]);
  }
  const Distribution2D distribution(kWidth, kHeight, weights);
  EXPECT_NEAR(distribution.total(), sum, 1e-5 * sum);
  std::vector<double> counts(weights.size(), 0.0);
  constexpr int kSamples = 200000;
  for (int i = 0; i < kSamples; ++i) {
    const auto pick = distribution.sample(rng.next2());
    ASSERT_TRUE(pick);
    counts[pick->y * kWidth + pick->x] += 1.0;
    ASSERT_FLOAT_EQ(pick->probability, distribution.probability(pick->x, pick->y));
    ASSERT_TRUE(pick->u.x >= 0.0f && pick->u.x < 1.0f && pick->u.y >= 0.0f && pick->u.y < 1.0f);
  }
  double chi2 = 0.0, total_probability = 0.0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double probability = static_cast<double>(distribution.probability(i % kWidth, i / kWidth));
    total_probability += probability;
    EXPECT_NEAR(probability, static_cast<double>(weights[i]) / sum, 1e-6);
    if (weights[i] == 0.0f) {
      EXPECT_EQ(counts[i], 0.0);
    } else {
      chi2 += (counts[i] - probability * kSamples) * (counts[i] - probability * kSamples) / (probability * kSamples);
    }
  }
  EXPECT_NEAR(total_probability, 1.0, 1e-6);
  EXPECT_LT(chi2, 60.0);  // at most 34 degrees of freedom: p = 0.004
}

TEST(Distribution2D, IsEmptyWhenAllIsBlack) {
  EXPECT_FALSE(Distribution2D(2, 2, std::vector<float>(4, 0.0f)).sample(Vec2f(0.5f, 0.5f)));
}

}  // namespace
}  // namespace pf
