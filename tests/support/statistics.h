#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <gtest/gtest.h>

namespace pf::test {

/// A mean over independent runs (different seeds), and its standard error.
struct Estimate {
  double mean = 0;
  double error = 0;
  int runs = 0;
};
[[nodiscard]] Estimate estimate(std::span<const double> values);

/// Probability that |t| is at least this large for Student's t with `dof` degrees of freedom
/// [Abramowitz and Stegun 1964, 26.7.3 and 26.7.4].
[[nodiscard]] double student_p(double t, int dof);
/// Significance of one of `count` independent tests, so that all of them together have `significance` [Sidak
/// 1967].
[[nodiscard]] double sidak(double significance, std::size_t count);

/// Probability with which one assertion below fails although nothing is wrong. Seeds are fixed: what passes
/// once, passes until the code changes.
inline constexpr double kSignificance = 1e-3;
/// Rounding of single precision along a path, relative: always allowed.
inline constexpr double kRounding = 2e-5;

/// t-test of the hypothesis that the expectation lies within `bias` of `expected`. `bias` is for errors that
/// more samples do not remove (a faceted sphere, the blur of a density estimate); the caller says which.
[[nodiscard]] testing::AssertionResult agrees(const Estimate& measured, double expected, double bias = 0.0);
/// The same for every element, with Sidak's correction for their number. `relative_bias` is a part of each
/// expected value.
[[nodiscard]] testing::AssertionResult all_agree(std::span<const Estimate> measured, std::span<const double> expected,
                                                 double relative_bias = 0.0);
/// Welch's t-test of two estimates of the same thing, element by element, corrected likewise. The bias
/// allowed is `relative_bias` times the second mean plus `absolute_bias`.
[[nodiscard]] testing::AssertionResult all_agree(std::span<const Estimate> a, std::span<const Estimate> b,
                                                 double relative_bias = 0.0, double absolute_bias = 0.0);

}  // namespace pf::test
