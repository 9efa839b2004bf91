#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "common/math/vec.h"

namespace pf::bench {

struct Point {
  double x = 0, y = 0;
};

/// Indices of the points that no other one beats: none has both x and y at most as large, and one of them smaller.
/// Ascending in x; of equal points the first. Points that are not finite are left out.
[[nodiscard]] std::vector<std::size_t> pareto_front(std::span<const Point> points);

/// Two-sided 95 % quantile of Student's t for this many degrees of freedom, at least 1.
[[nodiscard]] double student_t_95(int degrees_of_freedom);

/// y = intercept + slope x by least squares; [low, high] is the slope's 95 % interval, endless for fewer than three
/// points.
struct LineFit {
  double slope = 0, intercept = 0;
  double low = 0, high = 0;
  int points = 0;
};
/// Empty when fewer than two different x are given.
[[nodiscard]] std::optional<LineFit> fit_line(std::span<const Point> points);

/// Slope of log10(y) over log10(x) of one method, its runs kept apart. From three runs on, the interval is that of the
/// mean of the runs' own slopes: points of one run are not independent of each other. With fewer it comes from the
/// residuals of all points, and is too narrow. Points with x or y not above zero are left out.
struct SlopeFit {
  LineFit line;            ///< in log10 of both
  bool from_runs = false;  ///< what the interval comes from
};
[[nodiscard]] std::optional<SlopeFit> fit_slope(std::span<const std::vector<Point>> runs);

/// When a curve of errors first comes down to `target`, interpolated in the logarithms of both; points ascend in x.
struct TimeToError {
  enum class Kind { kReached, kBeforeFirst, kNotReached } kind = Kind::kNotReached;
  double seconds = 0;  ///< kBeforeFirst: of the first point, an upper bound; kNotReached: of the last, a lower bound
};
[[nodiscard]] TimeToError time_to_error(std::span<const Point> curve, double target);

/// What independent runs of one method differ from the truth by, split. All are means over pixels and channels of
/// squares, divided by r^2 + 0.01 as relMSE does where `relative` is asked for. Unbiased estimators: with n runs x_s,
/// their mean m and sample variance s^2, and a reference r of variance v per pixel,
///   variance = s^2,   bias2 = (m - r)^2 - s^2/n - v,   mse = variance + bias2.
/// bias2 may come out below zero, where it is nothing but noise; it is not clamped. `bias2_error`: standard error of
/// bias2, from leaving out one run after the other (jackknife); endless with fewer than three runs.
struct ErrorParts {
  double mse = 0, bias2 = 0, variance = 0;
  double bias2_error = 0;
  int runs = 0;
};
/// Empty with fewer than two images, or when sizes differ. `reference_variance`: per pixel and channel; may be empty
/// (none).
[[nodiscard]] std::optional<ErrorParts> error_parts(std::span<const std::vector<Rgb>> images,
                                                    std::span<const Rgb> reference,
                                                    std::span<const Rgb> reference_variance, bool relative);

/// From two independent halves: their mean, and the unbiased estimate (a - b)^2 / 4 of the mean's variance, per pixel
/// and channel.
struct Halves {
  std::vector<Rgb> mean, variance;
  double noise = 0;  ///< the mean's relMSE against the truth, as far as it is noise
};
[[nodiscard]] Halves join_halves(std::span<const Rgb> a, std::span<const Rgb> b);

}  // namespace pf::bench
