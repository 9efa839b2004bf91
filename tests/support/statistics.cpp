#include "tests/support/statistics.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace pf::test {
namespace {

/// How far a measured mean is off, in words.
struct Deviation {
  double p = 1.0;
  double measured = 0, expected = 0, error = 0;
  std::size_t index = 0;
};

double p_value(double difference, double allowed, double error, double dof) {
  const double excess = std::abs(difference) - allowed;
  if (!std::isfinite(difference)) return 0.0;
  if (excess <= 0.0) return 1.0;
  // A standard error of zero (every run gave the same) leaves no room beyond the bias.
  return error > 0.0 ? student_p(excess / error, std::max(1, static_cast<int>(dof))) : 0.0;
}

testing::AssertionResult verdict(const Deviation& worst, double threshold) {
  if (worst.p >= threshold) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "element " << worst.index << ": measured " << worst.measured << " +- "
                                     << worst.error << ", expected " << worst.expected << " (ratio "
                                     << worst.measured / worst.expected << "); p = " << worst.p << " is below "
                                     << threshold;
}

}  // namespace

Estimate estimate(std::span<const double> values) {
  Estimate e;
  e.runs = static_cast<int>(values.size());
  for (const double v : values) e.mean += v;
  e.mean /= e.runs;
  double squares = 0.0;
  for (const double v : values) squares += (v - e.mean) * (v - e.mean);
  if (e.runs > 1) e.error = std::sqrt(squares / (e.runs - 1) / e.runs);
  return e;
}

double student_p(double t, int dof) {
  const double theta = std::atan(std::abs(t) / std::sqrt(static_cast<double>(dof)));
  const double c = std::cos(theta);
  const bool odd = dof % 2 == 1;
  double term = odd ? c : 1.0;
  double sum = dof == 1 ? 0.0 : term;
  for (int k = odd ? 3 : 2; k <= dof - 2; k += 2) {
    term *= c * c * (k - 1) / k;
    sum += term;
  }
  const double inside = odd ? 2.0 / std::numbers::pi * (theta + std::sin(theta) * sum) : std::sin(theta) * sum;
  return std::max(0.0, 1.0 - inside);
}

double sidak(double significance, std::size_t count) {
  return -std::expm1(std::log1p(-significance) / static_cast<double>(count));
}

testing::AssertionResult agrees(const Estimate& measured, double expected, double bias) {
  const double p =
      p_value(measured.mean - expected, bias + kRounding * std::abs(expected), measured.error, measured.runs - 1);
  return verdict({p, measured.mean, expected, measured.error, 0}, kSignificance);
}

testing::AssertionResult all_agree(std::span<const Estimate> measured, std::span<const double> expected,
                                   double relative_bias) {
  if (measured.size() != expected.size()) return testing::AssertionFailure() << "sizes differ";
  Deviation worst;
  for (std::size_t i = 0; i < measured.size(); ++i) {
    const Estimate& m = measured[i];
    const double p =
        p_value(m.mean - expected[i], (relative_bias + kRounding) * std::abs(expected[i]), m.error, m.runs - 1);
    if (p < worst.p) worst = {p, m.mean, expected[i], m.error, i};
  }
  return verdict(worst, sidak(kSignificance, measured.size()));
}

testing::AssertionResult all_agree(std::span<const Estimate> a, std::span<const Estimate> b, double relative_bias,
                                   double absolute_bias) {
  if (a.size() != b.size()) return testing::AssertionFailure() << "sizes differ";
  Deviation worst;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double va = a[i].error * a[i].error;
    const double vb = b[i].error * b[i].error;
    // Degrees of freedom of a difference [Welch 1947; Satterthwaite 1946].
    const double spread = va * va / (a[i].runs - 1) + vb * vb / (b[i].runs - 1);
    const double dof = spread > 0.0 ? (va + vb) * (va + vb) / spread : 1.0;
    const double allowed = (relative_bias + kRounding) * std::abs(b[i].mean) + absolute_bias;
    const double p = p_value(a[i].mean - b[i].mean, allowed, std::sqrt(va + vb), dof);
    if (p < worst.p) worst = {p, a[i].mean, b[i].mean, std::sqrt(va + vb), i};
  }
  return verdict(worst, sidak(kSignificance, a.size()));
}

}  // namespace pf::test
