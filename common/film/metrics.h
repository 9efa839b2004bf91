#pragma once

#include <cstddef>
#include <span>

#include "common/math/vec.h"

namespace pf {

/// How far an image is from a reference. x is a channel of the image, r the same of the reference; "mean"
/// runs over all pixels and the three channels unless said otherwise. Sums are taken in pixel order in double
/// precision.
struct ErrorMetrics {
  double relative_mse = 0.0;          ///< mean of (x - r)^2 / (r^2 + 0.01)
  double relative_mse_trimmed = 0.0;  ///< the same without the worst 0.1 % of pixels (rounded up; one always stays)
  double rmse = 0.0;                  ///< square root of the mean of (x - r)^2
  double mae = 0.0;                   ///< mean of |x - r|
  double smape = 0.0;                 ///< mean of |x - r| / (|x| + |r| + 0.01)
  double max_error = 0.0;             ///< largest |x - r|
  double mean_ratio = 0.0;            ///< mean of x over mean of r; NaN where both are black
  std::size_t pixels = 0;
  /// Pixels with a NaN or infinite channel; `first` is the index of the first of them. With any, in either
  /// image, the figures above are NaN.
  struct Count {
    std::size_t nonfinite = 0;
    std::size_t negative = 0;
    std::size_t first_nonfinite = 0;
  };
  Count image, reference;

  [[nodiscard]] bool finite() const { return image.nonfinite == 0 && reference.nonfinite == 0; }
};

/// Compares two images of equally many pixels.
[[nodiscard]] ErrorMetrics compare_pixels(std::span<const Rgb> image, std::span<const Rgb> reference);

}  // namespace pf
