#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/film/image.h"

namespace pf {

/// One layer of an image, made small for a screen.
struct LayerPixels {
  int width = 0, height = 0;
  std::uint64_t passes = 0;        ///< sub-passes in it
  std::vector<std::uint16_t> rgb;  ///< half floats (IEEE 754 binary16), three a pixel, row by row from the top
};

/// What layers an image has.
struct LayerList {
  struct Entry {
    std::string name;  ///< as in the EXR; the nameless one is "beauty"
    std::vector<std::string> channels;
  };
  std::vector<Entry> layers;
  int width = 0, height = 0;
};

/// Of images that are served for looking at.
inline constexpr int kMaxPixelsWidth = 2048;

[[nodiscard]] LayerList layer_list(const ImageRows& image);
/// The layer's first three channels (one alone fills all three, a missing third is 0), every k x k pixels
/// averaged into one with the least k that makes the image at most `max_width` wide. Values beyond a half
/// float's range are clamped; NaN stays. Errors: kInvalidInput when there is no such layer.
[[nodiscard]] Result<LayerPixels> layer_pixels(const ImageRows& image, const std::string& layer, int max_width);

}  // namespace pf
