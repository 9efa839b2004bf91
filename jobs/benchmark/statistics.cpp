#include "jobs/benchmark/statistics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace pf::bench {
namespace {

constexpr double kRelativeFloor = 0.01;  // of relMSE, as in common/film/metrics.h
constexpr double kEndless = std::numeric_limits<double>::infinity();

double weight(double r, bool relative) { return relative ? 1.0 / (r * r + kRelativeFloor) : 1.0; }

Point logarithms(const Point& p) { return {std::log10(p.x), std::log10(p.y)}; }

double mean_of(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

/// Standard error of the mean.
double error_of_mean(std::span<const double> values) {
  const double mean = mean_of(values);
  double squares = 0;
  for (const double v : values) squares += (v - mean) * (v - mean);
  const auto n = static_cast<double>(values.size());
  return std::sqrt(squares / (n * (n - 1)));
}

/// Sums over runs of one channel of one pixel.
struct Moments {
  double n = 0, sum = 0, squares = 0;
  void add(double x) {
    n += 1;
    sum += x;
    squares += x * x;
  }
  void leave_out(double x) {
    n -= 1;
    sum -= x;
    squares -= x * x;
  }
  [[nodiscard]] double mean() const { return sum / n; }
  [[nodiscard]] double variance() const { return std::max(0.0, (squares - sum * sum / n) / (n - 1)); }
  [[nodiscard]] double bias2(double reference_variance) const {
    return mean() * mean() - variance() / n - reference_variance;
  }
};

}  // namespace

std::vector<std::size_t> pareto_front(std::span<const Point> points) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (std::isfinite(points[i].x) && std::isfinite(points[i].y)) order.push_back(i);
  }
  std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) {
    return points[a].x != points[b].x ? points[a].x < points[b].x : points[a].y < points[b].y;
  });
  std::vector<std::size_t> front;
  for (const std::size_t i : order) {
    if (front.empty() || points[i].y < points[front.back()].y) front.push_back(i);
  }
  return front;
}

double student_t_95(int degrees_of_freedom) {
  // [Abramowitz and Stegun 1964, table 26.10], 0.975; beyond 30 their expansion 26.7.5 in 1/n.
  constexpr std::array kTable = {12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
                                 2.201,  2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086,
                                 2.080,  2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042};
  const auto n = static_cast<std::size_t>(std::max(1, degrees_of_freedom));
  if (n <= kTable.size()) return kTable[n - 1];
  constexpr double z = 1.959964;
  const auto d = static_cast<double>(n);
  return z + (z * z * z + z) / (4 * d) + (5 * std::pow(z, 5) + 16 * z * z * z + 3 * z) / (96 * d * d);
}

std::optional<LineFit> fit_line(std::span<const Point> points) {
  const auto n = static_cast<double>(points.size());
  Point mean;
  for (const Point& p : points) {
    mean.x += p.x / n;
    mean.y += p.y / n;
  }
  double sxx = 0, sxy = 0;
  for (const Point& p : points) {
    sxx += (p.x - mean.x) * (p.x - mean.x);
    sxy += (p.x - mean.x) * (p.y - mean.y);
  }
  if (points.size() < 2 || !(sxx > 0)) return std::nullopt;
  LineFit fit;
  fit.points = static_cast<int>(points.size());
  fit.slope = sxy / sxx;
  fit.intercept = mean.y - fit.slope * mean.x;
  double residual = 0;
  for (const Point& p : points) {
    const double r = p.y - fit.intercept - fit.slope * p.x;
    residual += r * r;
  }
  const double half = fit.points > 2 ? student_t_95(fit.points - 2) * std::sqrt(residual / (n - 2) / sxx) : kEndless;
  fit.low = fit.slope - half;
  fit.high = fit.slope + half;
  return fit;
}

std::optional<SlopeFit> fit_slope(std::span<const std::vector<Point>> runs) {
  std::vector<Point> all;
  std::vector<double> slopes;
  for (const std::vector<Point>& run : runs) {
    std::vector<Point> logs;
    for (const Point& p : run) {
      if (p.x > 0 && p.y > 0 && std::isfinite(p.x) && std::isfinite(p.y)) logs.push_back(logarithms(p));
    }
    if (const auto own = fit_line(logs)) slopes.push_back(own->slope);
    all.insert(all.end(), logs.begin(), logs.end());
  }
  const auto line = fit_line(all);
  if (!line) return std::nullopt;
  SlopeFit fit{*line, slopes.size() >= 3};
  if (fit.from_runs) {
    const double mean = mean_of(slopes);
    const double half = student_t_95(static_cast<int>(slopes.size()) - 1) * error_of_mean(slopes);
    fit.line.intercept += (fit.line.slope - mean) * [&] {
      double x = 0;
      for (const Point& p : all) x += p.x / static_cast<double>(all.size());
      return x;
    }();
    fit.line.slope = mean;
    fit.line.low = mean - half;
    fit.line.high = mean + half;
  }
  return fit;
}

TimeToError time_to_error(std::span<const Point> curve, double target) {
  using Kind = TimeToError::Kind;
  if (curve.empty()) return {};
  if (curve.front().y <= target) return {Kind::kBeforeFirst, curve.front().x};
  for (std::size_t i = 1; i < curve.size(); ++i) {
    if (!(curve[i].y <= target)) continue;
    const Point a = logarithms(curve[i - 1]);
    const Point b = logarithms({curve[i].x, std::max(curve[i].y, 1e-300)});
    const double t = (a.y - std::log10(target)) / (a.y - b.y);
    return {Kind::kReached, std::pow(10.0, a.x + t * (b.x - a.x))};
  }
  return {Kind::kNotReached, curve.back().x};
}

std::optional<ErrorParts> error_parts(std::span<const std::vector<Rgb>> images, std::span<const Rgb> reference,
                                      std::span<const Rgb> reference_variance, bool relative) {
  const std::size_t runs = images.size();
  if (runs < 2 || reference.empty()) return std::nullopt;
  for (const auto& image : images) {
    if (image.size() != reference.size()) return std::nullopt;
  }
  ErrorParts parts;
  parts.runs = static_cast<int>(runs);
  const double share = 1.0 / (3.0 * static_cast<double>(reference.size()));
  std::vector<double> without(runs, 0.0);  // bias2 when this run is left out
  for (std::size_t i = 0; i < reference.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const double r = reference[i][c];
      const double w = share * weight(r, relative);
      const double v = reference_variance.empty() ? 0.0 : static_cast<double>(reference_variance[i][c]);
      Moments all;  // of differences: no digits are lost to a large mean
      for (const auto& image : images) all.add(static_cast<double>(image[i][c]) - r);
      parts.variance += w * all.variance();
      parts.bias2 += w * all.bias2(v);
      for (std::size_t s = 0; runs > 2 && s < runs; ++s) {
        Moments others = all;
        others.leave_out(static_cast<double>(images[s][i][c]) - r);
        without[s] += w * others.bias2(v);
      }
    }
  }
  parts.mse = parts.variance + parts.bias2;
  parts.bias2_error = runs > 2 ? static_cast<double>(runs - 1) * error_of_mean(without) : kEndless;
  return parts;
}

Halves join_halves(std::span<const Rgb> a, std::span<const Rgb> b) {
  Halves halves;
  halves.mean.reserve(a.size());
  halves.variance.reserve(a.size());
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    Rgb mean{0, 0, 0}, variance{0, 0, 0};
    for (int c = 0; c < 3; ++c) {
      mean[c] = 0.5f * (a[i][c] + b[i][c]);
      const float difference = a[i][c] - b[i][c];
      variance[c] = 0.25f * difference * difference;
      halves.noise += weight(mean[c], true) * static_cast<double>(variance[c]);
    }
    halves.mean.push_back(mean);
    halves.variance.push_back(variance);
  }
  if (!halves.mean.empty()) halves.noise /= 3.0 * static_cast<double>(halves.mean.size());
  return halves;
}

}  // namespace pf::bench
