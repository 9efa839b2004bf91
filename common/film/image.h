#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "common/math/vec.h"

namespace pf {

/// One layer of an image: `channels.size()` floats a pixel, interleaved, row by row from the top. In the EXR
/// the channels are called `<name>.<channel>`; the layer with the empty name (beauty) has plain R, G, B.
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

inline constexpr std::string_view kExrAttributePrefix = "photonfarm:";
/// Rows that writers ask for at a time: few, because OpenEXR gathers the 16 that it compresses together by itself.
inline constexpr int kImageRowsAtOnce = 4;

/// An image whose rows are made when they are written, so that it is never whole in memory.
struct ImageRows {
  int width = 0;
  int height = 0;
  /// The layers of `count` rows from `first` on, beauty first; the same layers for all rows. A writer asks for every
  /// row once, from the top.
  std::function<std::vector<Layer>(int first, int count)> rows;
  std::map<std::string, std::string> metadata;
};

/// The rows of an image that outlives them.
[[nodiscard]] ImageRows rows_of(const LayeredImage& image);

/// Largest edge and largest number of floats of an image that read_exr accepts; checked before pixels are
/// allocated.
inline constexpr int kMaxImageEdge = 1 << 16;
inline constexpr std::uint64_t kMaxImageFloats = std::uint64_t{1} << 29;

/// Writes a 32-bit float multi-layer EXR (ZIP) atomically: a crash or a full disk leaves the old file.
/// Errors: kInternal.
[[nodiscard]] Result<void> write_exr(const std::filesystem::path& file, const ImageRows& image);
[[nodiscard]] Result<void> write_exr(const std::filesystem::path& file, const LayeredImage& image);
/// Reads any scan-line or tiled RGB(A)/layered EXR (first part), display window respected: pixels of the data
/// window outside the display window are cut, missing ones are 0. Layers come with the beauty first, then by
/// name; channels in the order R, G, B, then by name, then A. Luminance-chroma files (Y, RY, BY) become R, G,
/// B of half precision. Deep data, and subsampled channels of other names, are refused. Errors: kInvalidInput
/// naming the file.
/// Given `only`, the name of a layer, the others have channels but no data.
[[nodiscard]] Result<LayeredImage> read_exr(const std::filesystem::path& file,
                                            const std::optional<std::string>& only = {});

/// The colours of a layer that has channels R, G and B, or of a grey one with Y alone. Errors: kInvalidInput,
/// without the file's name.
[[nodiscard]] Result<std::vector<Rgb>> rgb_pixels(const Layer& layer);

/// Writes the first layer (beauty) as 8-bit sRGB PNG: 2^exposure, then a filmic-free clamp to [0,1], sRGB curve.
/// Atomic. A pixel with a NaN becomes magenta, so that it is seen. Errors: kInternal.
[[nodiscard]] Result<void> write_png(const std::filesystem::path& file, const ImageRows& image, float exposure_stops);
/// Writes sRGB-encoded bytes, three a pixel, as PNG. Atomic. Errors: kInternal.
[[nodiscard]] Result<void> write_png(const std::filesystem::path& file, int width, int height,
                                     std::span<const std::uint8_t> rgb);

}  // namespace pf
