#include "worker/scene/image_header.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string_view>

#include <fmt/format.h>

namespace pf {
namespace {

using Bytes = std::span<const std::uint8_t>;
struct Size {
  std::uint32_t width = 0, height = 0;
};

bool has_text(Bytes bytes, std::size_t at, std::string_view text) {
  return bytes.size() >= at + text.size() &&
         std::equal(text.begin(), text.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at),
                    [](char c, std::uint8_t b) { return static_cast<std::uint8_t>(c) == b; });
}

std::uint32_t big_endian(Bytes bytes, std::size_t at, std::size_t count) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = value << 8 | bytes[at + i];
  return value;
}

std::uint32_t little_endian(Bytes bytes, std::size_t at, std::size_t count) {
  std::uint32_t value = 0;
  for (std::size_t i = count; i-- > 0;) value = value << 8 | bytes[at + i];
  return value;
}

/// PNG: walks the chunks, the first being IHDR, up to IEND [W3C PNG, 5.3 and 5.6]. OpenImageIO's reader leaks
/// memory when libpng jumps out of a short read, so that truncated files are kept from it. `data` becomes the
/// number of compressed bytes.
std::optional<Size> png_size(Bytes bytes, std::uint64_t& data) {
  constexpr std::size_t kSignature = 8, kAroundData = 12;  // length, type and checksum of a chunk
  if (bytes.size() < 33 || !has_text(bytes, 12, "IHDR")) return std::nullopt;
  for (std::size_t at = kSignature; bytes.size() - at >= kAroundData;) {
    const std::size_t length = big_endian(bytes, at, 4);
    if (bytes.size() - at - kAroundData < length) return std::nullopt;
    if (has_text(bytes, at + 4, "IEND")) return Size{big_endian(bytes, 16, 4), big_endian(bytes, 20, 4)};
    if (has_text(bytes, at + 4, "IDAT")) data += length;
    at += kAroundData + length;
  }
  return std::nullopt;
}

/// True when so few compressed bytes cannot become that many pixels: deflate makes at most 1032 bytes of one
/// [zlib, Technical Details]. Memory is taken by what a header promises, before a decoder finds out.
bool png_promises_too_much(Bytes bytes, Size size, std::uint64_t data) {
  constexpr std::uint64_t kMostOfOneByte = 1032;
  constexpr std::array<std::uint64_t, 7> kChannels = {1, 1, 3, 1, 2, 1, 4};  // by colour type [W3C PNG, 11.2.1]
  const std::uint64_t channels = kChannels[std::min<std::size_t>(bytes[25], kChannels.size() - 1)];
  const std::uint64_t row = 1 + (std::uint64_t{size.width} * channels * bytes[24] + 7) / 8;  // with its filter's type
  return row * size.height > data * kMostOfOneByte;
}

bool is_start_of_frame(std::uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

/// JPEG: walks the segments up to the end-of-image marker [ITU-T T.81, annex B].
std::optional<Size> jpeg_size(Bytes bytes) {
  std::optional<Size> size;
  std::size_t at = 2;  // past SOI
  while (true) {
    while (at < bytes.size() && bytes[at] != 0xFF) ++at;  // entropy-coded data, or padding
    while (at < bytes.size() && bytes[at] == 0xFF) ++at;  // fill bytes
    if (at >= bytes.size()) return std::nullopt;          // no end of image: truncated
    const std::uint8_t marker = bytes[at++];
    const bool stands_alone = marker == 0x00 || marker == 0x01 || (marker >= 0xD0 && marker <= 0xD8);
    if (stands_alone) continue;  // a stuffed 0xFF of entropy-coded data, or a restart
    if (marker == 0xD9) return size;
    if (bytes.size() - at < 2) return std::nullopt;
    const std::uint32_t length = big_endian(bytes, at, 2);
    if (length < 2 || bytes.size() - at < length) return std::nullopt;
    if (is_start_of_frame(marker) && length >= 8)
      size = Size{big_endian(bytes, at + 5, 2), big_endian(bytes, at + 3, 2)};
    at += length;
  }
}

/// WebP: extended, lossless or lossy [RFC 9649, 2.4 to 2.7].
std::optional<Size> webp_size(Bytes bytes) {
  if (bytes.size() < 30 || std::uint64_t{little_endian(bytes, 4, 4)} + 8 > bytes.size()) return std::nullopt;
  if (has_text(bytes, 12, "VP8X")) return Size{little_endian(bytes, 24, 3) + 1, little_endian(bytes, 27, 3) + 1};
  if (has_text(bytes, 12, "VP8L")) {
    const std::uint32_t bits = little_endian(bytes, 21, 4);
    return Size{(bits & 0x3FFFu) + 1, (bits >> 14 & 0x3FFFu) + 1};
  }
  if (has_text(bytes, 12, "VP8 "))
    return Size{little_endian(bytes, 26, 2) & 0x3FFFu, little_endian(bytes, 28, 2) & 0x3FFFu};
  return std::nullopt;
}

}  // namespace

Result<ImageHeader> read_image_header(Bytes bytes, const std::string& name) {
  ImageHeader header;
  std::optional<Size> size;
  std::uint64_t png_data = 0;
  if (has_text(bytes, 0, "\x89PNG\r\n\x1A\n")) {
    header.format = ImageFormat::kPng;
    size = png_size(bytes, png_data);
  } else if (bytes.size() >= 3 && big_endian(bytes, 0, 3) == 0xFFD8FFu) {
    header.format = ImageFormat::kJpeg;
    size = jpeg_size(bytes);
  } else if (has_text(bytes, 0, "RIFF") && has_text(bytes, 8, "WEBP")) {
    header.format = ImageFormat::kWebp;
    size = webp_size(bytes);
  } else {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: unknown image format; expected PNG, JPEG or WebP", name));
  }
  if (!size) return fail(ErrorKind::kInvalidInput, fmt::format("{}: image is truncated or damaged", name));
  if (size->width == 0 || size->height == 0) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: image is {} x {} pixels; expected at least 1 x 1", name, size->width, size->height));
  }
  if (size->width > kMaxImageSide || size->height > kMaxImageSide) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: image is {} x {} pixels; at most {} x {} are supported",
                                                      name, size->width, size->height, kMaxImageSide, kMaxImageSide));
  }
  if (header.format == ImageFormat::kPng && png_promises_too_much(bytes, *size, png_data)) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: image is {} x {} pixels, more than its {} bytes of data can hold", name, size->width,
                            size->height, png_data));
  }
  header.width = size->width;
  header.height = size->height;
  return header;
}

}  // namespace pf
