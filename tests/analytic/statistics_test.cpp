#include "tests/support/statistics.h"

#include <array>
#include <cmath>

#include <gtest/gtest.h>

namespace pf::test {
namespace {

// Critical values of two-sided tests, from any printed table of Student's t: three decimals.
TEST(Statistics, StudentsTAgreesWithPrintedTables) {
  EXPECT_NEAR(student_p(12.706, 1), 0.05, 1e-5);
  EXPECT_NEAR(student_p(4.303, 2), 0.05, 1e-5);
  EXPECT_NEAR(student_p(2.365, 7), 0.05, 5e-5);
  EXPECT_NEAR(student_p(3.499, 7), 0.01, 1e-5);
  EXPECT_NEAR(student_p(5.408, 7), 0.001, 1e-6);
  EXPECT_NEAR(student_p(2.947, 15), 0.01, 1e-5);
  EXPECT_NEAR(student_p(-3.850, 30), 0.000574, 5e-6);
  EXPECT_NEAR(student_p(1.96, 100000), 0.05, 1e-5);
}

TEST(Statistics, SidaksCorrectionGivesBackTheWholeSignificance) {
  EXPECT_DOUBLE_EQ(sidak(0.01, 1), 0.01);
  EXPECT_NEAR(1.0 - std::pow(1.0 - sidak(0.01, 576), 576.0), 0.01, 1e-12);
}

TEST(Statistics, AMeanAndItsErrorAreThoseOfTheTextbook) {
  const std::array<double, 4> values{1, 2, 3, 6};
  const Estimate e = estimate(values);
  EXPECT_DOUBLE_EQ(e.mean, 3.0);
  EXPECT_DOUBLE_EQ(e.error, std::sqrt(14.0 / 3.0 / 4.0));
}

TEST(Statistics, ATestRejectsWhatIsFarAndAcceptsWhatTheBiasExplains) {
  const Estimate e{1.05, 0.005, 8};
  EXPECT_FALSE(agrees(e, 1.0));
  EXPECT_TRUE(agrees(e, 1.0, 0.05));
  EXPECT_TRUE(agrees(e, 1.05));
  EXPECT_FALSE(agrees({std::nan(""), 0.1, 8}, 1.0));
  EXPECT_FALSE(agrees({1.001, 0.0, 8}, 1.0));
}

}  // namespace
}  // namespace pf::test
