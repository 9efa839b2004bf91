#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <functional>
#include <memory>
#include <system_error>
#include <tuple>

#include <fmt/format.h>
#include <png.h>

#include "common/base/atomic_file.h"
#include "common/film/image.h"

namespace pf {
namespace {

constexpr std::array<std::uint8_t, 3> kNanColor = {255, 0, 255};

/// sRGB curve of IEC 61966-2-1 for a value already in [0, 1], rounded to 8 bits.
[[nodiscard]] std::uint8_t encode_srgb(float linear) {
  const float encoded = linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1.0f / 2.4f) - 0.055f;
  return static_cast<std::uint8_t>(std::lround(255.0f * encoded));
}

/// Fills one row of sRGB bytes; asked for every row once, from the top. Errors end the writing.
using FillRow = std::function<Result<void>(int row, std::span<std::uint8_t> rgb)>;

struct CloseFile {
  void operator()(std::FILE* file) const { std::ignore = std::fclose(file); }
};

struct Encoder {
  std::FILE* file = nullptr;
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
  if (std::fwrite(data, 1, size, static_cast<Encoder*>(png_get_io_ptr(png))->file) != size) {
    // Not a std::string: png_error leaves by longjmp.
    std::array<char, 128> text{};
    png_error(png, ::strerror_r(errno, text.data(), text.size()));
  }
}
void pf_png_flush(png_structp) {}
}

// The parts of the work that libpng may leave by longjmp: only trivial locals live here.

[[nodiscard]] bool begin(png_structp png, png_infop info, png_uint_32 width, png_uint_32 height) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_IHDR(png, info, width, height, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  // sRGB for readers that know it, the gAMA and cHRM that the PNG specification recommends beside it for
  // others.
  png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_RELATIVE);
  png_write_info(png, info);
  return true;
}

[[nodiscard]] bool add_row(png_structp png, const std::uint8_t* rgb) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_row(png, rgb);
  return true;
}

[[nodiscard]] bool end(png_structp png, png_infop info) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_end(png, info);
  return true;
}

/// libpng's two structs, freed whatever happens.
class PngStructs {
 public:
  explicit PngStructs(Encoder& encoder)
      : png(png_create_write_struct(PNG_LIBPNG_VER_STRING, &encoder, pf_png_error, pf_png_warning)),
        info(png != nullptr ? png_create_info_struct(png) : nullptr) {
    if (info != nullptr) png_set_write_fn(png, &encoder, pf_png_write, pf_png_flush);
  }
  ~PngStructs() { png_destroy_write_struct(&png, &info); }
  PngStructs(const PngStructs&) = delete;
  PngStructs& operator=(const PngStructs&) = delete;

  png_structp png;
  png_infop info;
};

[[nodiscard]] Result<void> encode(std::FILE* file, int width, int height, const FillRow& fill) {
  Encoder encoder{file, {}};
  PngStructs structs(encoder);
  const auto failed = [&] {
    return fail(ErrorKind::kInternal, encoder.error.empty() ? "out of memory" : encoder.error);
  };
  if (structs.info == nullptr) return failed();
  if (!begin(structs.png, structs.info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height))) {
    return failed();
  }
  std::vector<std::uint8_t> rgb(std::size_t{3} * width);
  for (int y = 0; y < height; ++y) {
    if (auto filled = fill(y, rgb); !filled) return filled;
    if (!add_row(structs.png, rgb.data())) return failed();
  }
  if (!end(structs.png, structs.info)) return failed();
  return {};
}

[[nodiscard]] Result<void> write_rows(const std::filesystem::path& file, int width, int height, const FillRow& fill) {
  const auto unwritten = [&](const std::string& why) {
    return fail(ErrorKind::kInternal, fmt::format("{}: PNG not written: {}", file.string(), why));
  };
  if (width <= 0 || height <= 0) return unwritten(fmt::format("an image of {}x{} pixels", width, height));
  return write_file_atomically(file, [&](const std::filesystem::path& temporary) -> Result<void> {
    std::unique_ptr<std::FILE, CloseFile> stream(std::fopen(temporary.c_str(), "wb"));
    if (!stream) return unwritten(std::generic_category().message(errno));
    if (const auto encoded = encode(stream.get(), width, height, fill); !encoded) {
      return unwritten(encoded.error().message);
    }
    if (std::fclose(stream.release()) != 0) return unwritten(std::generic_category().message(errno));
    return {};
  });
}

void expose(const Rgb& pixel, float scale, std::uint8_t* rgb) {
  const Rgb exposed = pixel * scale;
  if (std::isnan(exposed.x) || std::isnan(exposed.y) || std::isnan(exposed.z)) {
    std::ranges::copy(kNanColor, rgb);
    return;
  }
  for (const float value : {exposed.x, exposed.y, exposed.z}) *rgb++ = encode_srgb(std::clamp(value, 0.0f, 1.0f));
}

}  // namespace

Result<void> write_png(const std::filesystem::path& file, int width, int height, std::span<const std::uint8_t> rgb) {
  if (width > 0 && height > 0 && rgb.size() != std::size_t{3} * width * height) {
    return fail(ErrorKind::kInternal,
                fmt::format("{}: {} bytes given for a PNG of {}x{} pixels", file.string(), rgb.size(), width, height));
  }
  return write_rows(file, width, height, [&](int y, std::span<std::uint8_t> row) -> Result<void> {
    std::ranges::copy(rgb.subspan(row.size() * static_cast<std::size_t>(y), row.size()), row.begin());
    return {};
  });
}

Result<void> write_png(const std::filesystem::path& file, const ImageRows& image, float exposure_stops) {
  const float scale = std::exp2(exposure_stops);
  const auto width = static_cast<std::size_t>(std::max(image.width, 0));
  std::vector<Rgb> block;
  return write_rows(file, image.width, image.height, [&](int y, std::span<std::uint8_t> row) -> Result<void> {
    if (y % kImageRowsAtOnce == 0) {
      const int count = std::min(kImageRowsAtOnce, image.height - y);
      const std::vector<Layer> layers = image.rows(y, count);
      auto beauty = layers.empty() ? fail(ErrorKind::kInternal, "an image without layers") : rgb_pixels(layers.front());
      if (!beauty) return tl::unexpected(beauty.error());
      if (beauty->size() != width * static_cast<std::size_t>(count)) {
        return fail(ErrorKind::kInternal,
                    fmt::format("{} pixels given for {} rows of {}", beauty->size(), count, width));
      }
      block = std::move(*beauty);
    }
    const std::size_t first = width * static_cast<std::size_t>(y % kImageRowsAtOnce);
    for (std::size_t x = 0; x < width; ++x) expose(block[first + x], scale, row.data() + 3 * x);
    return {};
  });
}

}  // namespace pf
