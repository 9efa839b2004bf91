#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/math/vec.h"

namespace pf {

/// Decoding by OpenImageIO, kept in one translation unit: its bundled fmt clashes with ours.

struct PixelLayout {
  std::size_t width = 0;
  std::size_t height = 0;
  std::size_t channels = 0;           ///< 1 grey, 2 grey and alpha, 3 RGB, 4 RGBA
  std::size_t bytes_per_channel = 1;  ///< 1 or 2 (native byte order)
};

/// Receives an image row by row, so that no second copy of it is held.
struct RowSink {
  std::function<Result<void>(const PixelLayout&)> begin;
  std::function<void(std::size_t y, std::span<const std::uint8_t> row)> row;
};

/// Decodes an encoded PNG, JPEG or WebP image as stored: alpha not multiplied in, no colour conversion. Rows
/// from the top. Errors: kInvalidInput, led by `name`; those of sink.begin.
[[nodiscard]] Result<void> decode_image(std::span<const std::uint8_t> encoded, const std::string& name,
                                        const RowSink& sink);

/// A high dynamic range image, linear RGB, rows from the top.
struct RadianceMap {
  std::size_t width = 0;
  std::size_t height = 0;
  std::vector<Rgb> pixels;
};

/// Reads a Radiance .hdr or an OpenEXR file, told apart by content: the first part's largest level, its
/// display window (black where there is no data). Errors: kInvalidInput naming the file (too large included:
/// more than 2^27 pixels or 65536 on a side).
[[nodiscard]] Result<RadianceMap> read_radiance_map(const std::string& file);

}  // namespace pf
