#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/math/vec.h"

namespace pf {

/// One layer of an image: `channels.size()` floats a pixel, interleaved, row by row from the top. In the EXR the
/// channels are called `<name>.<channel>`; the layer with the empty name (beauty) has plain R, G, B.
struct Layer {
  std::string name;
  std::vector<std::string> channels;
  std::vector<float> data;
};

/// An image of several layers with text metadata (EXR header attributes, prefix `photonfarm:`).
struct LayeredImage {
  int width = 0;
  int height = 0;
  std::vector<Layer> layers;
  std::map<std::string, std::string> metadata;

  [[nodiscard]] const Layer* find(const std::string& name) const;
};

/// Writes a 32-bit float multi-layer EXR (ZIP) atomically: a crash or a full disk leaves the old file.
[[nodiscard]] Result<void> write_exr(const std::filesystem::path& file, const LayeredImage& image);
/// Reads any scan-line or tiled RGB(A)/layered EXR (first part), display window respected: pixels of the data window
/// outside the display window are cut, missing ones are 0. Errors: kInvalidInput naming the file.
[[nodiscard]] Result<LayeredImage> read_exr(const std::filesystem::path& file);
/// Writes the beauty as 8-bit sRGB PNG: 2^exposure, then a filmic-free clamp to [0,1], sRGB curve. Atomic.
[[nodiscard]] Result<void> write_png(const std::filesystem::path& file, int width, int height,
                                     const std::vector<Rgb>& beauty, float exposure_stops);

}  // namespace pf
