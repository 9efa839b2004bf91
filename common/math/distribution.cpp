#include "common/math/distribution.h"

#include <algorithm>
#include <cmath>

#include "common/math/sampling.h"

namespace pf {
namespace {

double usable(float weight) { return std::isfinite(weight) && weight > 0.0f ? static_cast<double>(weight) : 0.0; }

/// Number of elements of sorted values[0..n) that are <= u, without branches that a processor could
/// mispredict.
template <typename T>
std::size_t count_not_above(const T* values, std::size_t n, T u) {
  const T* first = values;
  while (n > 1) {
    const std::size_t half = n / 2;
    first += first[half - 1] <= u ? half : 0;
    n -= half;
  }
  return static_cast<std::size_t>(first - values) + (n == 1 && *first <= u ? 1u : 0u);
}

/// Position of u within [low, high), in [0, 1).
template <typename T>
float rescale(T u, T low, T high) {
  return std::clamp(static_cast<float>((u - low) / (high - low)), 0.0f, kOneMinusEpsilon);
}

}  // namespace

Distribution1D::Distribution1D(std::span<const float> weights) : cdf_(weights.size() + 1, 0.0) {
  for (std::size_t i = 0; i < weights.size(); ++i) cdf_[i + 1] = cdf_[i] + usable(weights[i]);
  total_ = cdf_.back();
  if (total_ <= 0.0) return;
  for (double& value : cdf_) value /= total_;  // the last becomes exactly 1, and so does every one of equal sum
}

std::optional<Distribution1D::Pick> Distribution1D::sample(float u) const {
  if (total_ <= 0.0) return std::nullopt;
  const double x = static_cast<double>(std::clamp(u, 0.0f, kOneMinusEpsilon));
  // The first border above u closes the cell; cells of weight 0 have no extent and are never hit.
  const std::size_t index = count_not_above(cdf_.data() + 1, size(), x);
  return Pick{static_cast<std::uint32_t>(index), probability(index), rescale(x, cdf_[index], cdf_[index + 1])};
}

float Distribution1D::probability(std::size_t index) const {
  return total_ > 0.0 ? static_cast<float>(cdf_[index + 1] - cdf_[index]) : 0.0f;
}

Distribution2D::Distribution2D(std::size_t width, std::size_t height, std::span<const float> weights)
    : columns_(width * height, 0.0f), width_(width) {
  std::vector<float> row_sums(height, 0.0f);
  for (std::size_t y = 0; y < height; ++y) {
    const auto row = weights.subspan(y * width, width);
    double sum = 0.0;
    for (const float weight : row) sum += usable(weight);
    row_sums[y] = static_cast<float>(sum);
    if (sum <= 0.0) continue;
    double running = 0.0;
    for (std::size_t x = 0; x < width; ++x) {
      running += usable(row[x]);
      columns_[y * width + x] = static_cast<float>(running / sum);
    }
  }
  rows_ = Distribution1D(row_sums);
}

std::optional<Distribution2D::Pick> Distribution2D::sample(const Vec2f& u) const {
  const auto row = rows_.sample(u.y);
  if (!row) return std::nullopt;
  const float* cdf = columns_.data() + row->index * width_;
  const float x = std::clamp(u.x, 0.0f, kOneMinusEpsilon);
  const std::size_t column = count_not_above(cdf, width_, x);
  const float low = column == 0 ? 0.0f : cdf[column - 1];
  return Pick{static_cast<std::uint32_t>(column), row->index, row->probability * (cdf[column] - low),
              Vec2f(rescale(x, low, cdf[column]), row->u)};
}

float Distribution2D::probability(std::size_t x, std::size_t y) const {
  const float* cdf = columns_.data() + y * width_;
  return rows_.probability(y) * (cdf[x] - (x == 0 ? 0.0f : cdf[x - 1]));
}

}  // namespace pf
