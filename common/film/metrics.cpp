#include "common/film/metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace pf {
namespace {

constexpr double kRelativeFloor = 0.01;  // added to r^2, and to |x| + |r|: keeps dark pixels from ruling the mean
constexpr double kTrimmedShare = 0.001;

[[nodiscard]] ErrorMetrics::Count inspect(std::span<const Rgb> pixels) {
  ErrorMetrics::Count count;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (!is_finite(pixels[i])) {
      if (count.nonfinite++ == 0) count.first_nonfinite = i;
    }
    if (min_component(pixels[i]) < 0.0f) ++count.negative;
  }
  return count;
}

[[nodiscard]] double sum_of(std::span<const double> values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return sum;
}

}  // namespace

ErrorMetrics compare_pixels(std::span<const Rgb> image, std::span<const Rgb> reference) {
  ErrorMetrics metrics;
  metrics.pixels = image.size();
  metrics.image = inspect(image);
  metrics.reference = inspect(reference);
  if (!metrics.finite() || image.size() != reference.size() || image.empty()) {
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    metrics.relative_mse = metrics.relative_mse_trimmed = metrics.rmse = metrics.mae = kNone;
    metrics.smape = metrics.max_error = metrics.mean_ratio = kNone;
    return metrics;
  }
  std::vector<double> relative;  // per pixel, mean over its channels
  relative.reserve(image.size());
  double squares = 0.0;
  double sum_x = 0.0;
  double sum_r = 0.0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    double pixel = 0.0;
    for (int channel = 0; channel < 3; ++channel) {
      const double x = image[i][channel];
      const double r = reference[i][channel];
      const double difference = std::abs(x - r);
      pixel += difference * difference / (r * r + kRelativeFloor);
      squares += difference * difference;
      metrics.mae += difference;
      metrics.smape += difference / (std::abs(x) + std::abs(r) + kRelativeFloor);
      metrics.max_error = std::max(metrics.max_error, difference);
      sum_x += x;
      sum_r += r;
    }
    relative.push_back(pixel / 3.0);
  }
  const double pixels = static_cast<double>(image.size());
  metrics.relative_mse = sum_of(relative) / pixels;
  metrics.rmse = std::sqrt(squares / (3.0 * pixels));
  metrics.mae /= 3.0 * pixels;
  metrics.smape /= 3.0 * pixels;
  metrics.mean_ratio = sum_x / sum_r;
  std::ranges::sort(relative);
  const auto worst = static_cast<std::size_t>(std::ceil(kTrimmedShare * pixels));
  const std::size_t kept = std::max<std::size_t>(1, relative.size() - worst);
  metrics.relative_mse_trimmed = sum_of(std::span(relative).first(kept)) / static_cast<double>(kept);
  return metrics;
}

}  // namespace pf
