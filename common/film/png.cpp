#include <algorithm>
#include <array>
#include <cmath>
#include <csetjmp>
#include <exception>

#include <fmt/format.h>
#include <png.h>

#include "common/base/atomic_file.h"
#include "common/film/image.h"

namespace pf {
namespace {

constexpr std::array<std::uint8_t, 3> kNanColor = {255, 0, 255};

/// sRGB curve of IEC 61966-2-1 for a value already in [0, 1], rounded to 8 bits.
[[nodiscard]] std::uint8_t encode_srgb(float linear) {
  const float encoded =
      linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1.0f / 2.4f) - 0.055f;
  return static_cast<std::uint8_t>(std::lround(255.0f * encoded));
}

struct Encoder {
  std::string bytes;
  std::string error;
};

extern "C" {
// libpng leaves by longjmp, so these let no exception out and hold nothing with a destructor when they jump.
[[noreturn]] void pf_png_error(png_structp png, png_const_charp message) {
  auto* encoder = static_cast<Encoder*>(png_get_error_ptr(png));
  try {
    encoder->error = message;
  } catch (...) {
    encoder->error.clear();
  }
  png_longjmp(png, 1);
}
void pf_png_warning(png_structp, png_const_charp) {}
void pf_png_write(png_structp png, png_bytep data, std::size_t size) {
  bool ok = true;
  try {
    static_cast<Encoder*>(png_get_io_ptr(png))->bytes.append(reinterpret_cast<const char*>(data), size);
  } catch (...) {
    ok = false;
  }
  if (!ok) png_error(png, "out of memory");
}
void pf_png_flush(png_structp) {}
}

/// The part of the work that libpng may leave by longjmp: only trivial locals live here.
[[nodiscard]] bool encode(png_structp png, png_infop info, png_uint_32 width, png_uint_32 height,
                          const std::uint8_t* rgb) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_IHDR(png, info, width, height, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  // sRGB for readers that know it, the gAMA and cHRM that the PNG specification recommends beside it for
  // others.
  png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_RELATIVE);
  png_write_info(png, info);
  for (png_uint_32 y = 0; y < height; ++y) png_write_row(png, rgb + std::size_t{3} * width * y);
  png_write_end(png, info);
  return true;
}

}  // namespace

Result<void> write_png(const std::filesystem::path& file, int width, int height,
                       std::span<const std::uint8_t> rgb) {
  if (width <= 0 || height <= 0 || rgb.size() != std::size_t{3} * width * height) {
    return fail(ErrorKind::kInternal, fmt::format("{}: {} bytes given for a PNG of {}x{} pixels",
                                                  file.string(), rgb.size(), width, height));
  }
  Encoder encoder;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &encoder, pf_png_error, pf_png_warning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  bool ok = info != nullptr;
  if (ok) {
    png_set_write_fn(png, &encoder, pf_png_write, pf_png_flush);
    ok = encode(png, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), rgb.data());
  }
  png_destroy_write_struct(&png, &info);
  if (!ok) {
    return fail(ErrorKind::kInternal, fmt::format("{}: PNG not written: {}", file.string(),
                                                  encoder.error.empty() ? "out of memory" : encoder.error));
  }
  return write_file_atomically(file, std::string_view(encoder.bytes));
}

Result<void> write_png(const std::filesystem::path& file, int width, int height,
                       const std::vector<Rgb>& beauty, float exposure_stops) {
  const float scale = std::exp2(exposure_stops);
  std::vector<std::uint8_t> rgb;
  rgb.reserve(3 * beauty.size());
  for (const Rgb& pixel : beauty) {
    const Rgb exposed = pixel * scale;
    if (std::isnan(exposed.x) || std::isnan(exposed.y) || std::isnan(exposed.z)) {
      rgb.insert(rgb.end(), kNanColor.begin(), kNanColor.end());
      continue;
    }
    for (const float value : {exposed.x, exposed.y, exposed.z}) {
      rgb.push_back(encode_srgb(std::clamp(value, 0.0f, 1.0f)));
    }
  }
  return write_png(file, width, height, std::span<const std::uint8_t>(rgb));
}

}  // namespace pf
