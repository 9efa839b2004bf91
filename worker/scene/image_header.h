#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "common/base/result.h"

namespace pf {

enum class ImageFormat { kPng, kJpeg, kWebp };

/// What the first bytes of an encoded image promise. Read before a decoder sees the file: decoders allocate
/// by these numbers, and libjpeg fills what is missing from a truncated file with grey without an error.
struct ImageHeader {
  ImageFormat format = ImageFormat::kPng;
  std::uint32_t width = 0;
  std::uint32_t height = 0;
};

/// Largest width and height that is read [pixels].
inline constexpr std::uint32_t kMaxImageSide = 16384;

/// Reads the header and checks that the image is complete as far as its structure tells. `name` leads the
/// messages. Errors: kInvalidInput (unknown format, damaged, truncated, empty, too large).
[[nodiscard]] Result<ImageHeader> read_image_header(std::span<const std::uint8_t> bytes, const std::string& name);

}  // namespace pf
