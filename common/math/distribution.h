#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/math/vec.h"

namespace pf {

/// Picks one of n items with probability proportional to its weight, by bisection of the cumulative sums: the
/// map from `u` is monotone, so that stratified numbers stay stratified (an alias table would scatter them).
class Distribution1D {
 public:
  Distribution1D() = default;
  /// Weights that are negative or not finite count as 0.
  explicit Distribution1D(std::span<const float> weights);

  struct Pick {
    std::uint32_t index = 0;
    float probability = 0;
    float u = 0;  ///< what is left of the random number: uniform in [0, 1) given `index`
  };
  /// Empty when every weight is 0. `u` in [0, 1).
  [[nodiscard]] std::optional<Pick> sample(float u) const;
  [[nodiscard]] float probability(std::size_t index) const;
  /// Sum of the weights.
  [[nodiscard]] double total() const { return total_; }
  [[nodiscard]] std::size_t size() const { return cdf_.empty() ? 0 : cdf_.size() - 1; }

 private:
  std::vector<double> cdf_;  ///< n + 1 values from 0 to 1
  double total_ = 0.0;
};

/// Picks a cell of a grid with probability proportional to its weight: a row first, then a column of the row.
class Distribution2D {
 public:
  Distribution2D() = default;
  /// `weights` row after row, width * height of them; negative or not finite ones count as 0.
  Distribution2D(std::size_t width, std::size_t height, std::span<const float> weights);

  struct Pick {
    std::uint32_t x = 0, y = 0;
    float probability = 0;
    Vec2f u;  ///< position within the cell, uniform in [0, 1)^2
  };
  /// Empty when every weight is 0. u.x chooses the column, u.y the row.
  [[nodiscard]] std::optional<Pick> sample(const Vec2f& u) const;
  [[nodiscard]] float probability(std::size_t x, std::size_t y) const;
  [[nodiscard]] double total() const { return rows_.total(); }

 private:
  Distribution1D rows_;
  std::vector<float> columns_;  ///< for each row, cumulative sums at the right border of each cell, up to 1
  std::size_t width_ = 0;
};

}  // namespace pf
