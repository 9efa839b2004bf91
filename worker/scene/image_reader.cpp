#include "worker/scene/image_reader.h"

#include <algorithm>
#include <array>
#include <exception>
#include <fstream>
#include <memory>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include "worker/scene/image_header.h"

// No <fmt/...> here: OpenImageIO brings a copy of its own with exceptions turned off.

namespace pf {
namespace {

constexpr std::size_t kRowsAtOnce = 64;
constexpr std::int64_t kMaxMapPixels = std::int64_t{1} << 27;
constexpr int kMaxMapSide = 65536;
/// OpenImageIO takes a buffer for 64 rows, or for a row of tiles, of all channels, whatever is asked for.
constexpr std::uint64_t kMaxStripBytes = std::uint64_t{1} << 31;

tl::unexpected<Error> broken(const std::string& name, std::string what) {
  while (!what.empty() && (what.back() == '\n' || what.back() == '.')) what.pop_back();
  std::replace(what.begin(), what.end(), '\n', ' ');
  return fail(ErrorKind::kInvalidInput, name + ": " + (what.empty() ? "image cannot be decoded" : what));
}

const char* plugin(ImageFormat format) {
  switch (format) {
    case ImageFormat::kPng:
      return "png";
    case ImageFormat::kJpeg:
      return "jpeg";
    case ImageFormat::kWebp:
      return "webp";
  }
  return "";
}

Result<void> decode_with(OIIO::ImageInput& input, std::span<const std::uint8_t> encoded, const std::string& name,
                         const RowSink& sink) {
  OIIO::Filesystem::IOMemReader memory(encoded.data(), encoded.size());
  if (!input.set_ioproxy(&memory)) return broken(name, "OpenImageIO cannot read this format from memory");
  OIIO::ImageSpec wanted, spec;
  wanted.attribute("oiio:UnassociatedAlpha", 1);  // glTF does not multiply colour by alpha
  if (!input.open("", spec, wanted)) return broken(name, input.geterror());

  PixelLayout layout;
  layout.width = static_cast<std::size_t>(spec.width);
  layout.height = static_cast<std::size_t>(spec.height);
  layout.channels = static_cast<std::size_t>(spec.nchannels);
  layout.bytes_per_channel = spec.format.size() > 1 ? 2 : 1;
  if (spec.width < 1 || spec.height < 1 || spec.width > static_cast<int>(kMaxImageSide) ||
      spec.height > static_cast<int>(kMaxImageSide) || layout.channels < 1 || layout.channels > 4) {
    return broken(name, "decoder and header disagree about the size of the image");
  }
  if (auto begun = sink.begin(layout); !begun) return begun;

  const OIIO::TypeDesc type = layout.bytes_per_channel == 2 ? OIIO::TypeUInt16 : OIIO::TypeUInt8;
  const std::size_t row_bytes = layout.width * layout.channels * layout.bytes_per_channel;
  std::vector<std::uint8_t> rows(row_bytes * std::min(kRowsAtOnce, layout.height));
  for (std::size_t y = 0; y < layout.height; y += kRowsAtOnce) {
    const std::size_t end = std::min(y + kRowsAtOnce, layout.height);
    if (!input.read_scanlines(0, 0, static_cast<int>(y), static_cast<int>(end), 0, 0, spec.nchannels, type,
                              rows.data())) {
      return broken(name, input.geterror());
    }
    for (std::size_t i = y; i < end; ++i) sink.row(i, std::span(rows).subspan((i - y) * row_bytes, row_bytes));
  }
  return {};
}

/// Position of R, G and B in the file, or of its only luminance three times; negative where there are none.
std::array<int, 3> colour_channels(const OIIO::ImageSpec& spec) {
  const auto find = [&](const char* name) {
    const auto it = std::find(spec.channelnames.begin(), spec.channelnames.end(), name);
    return it == spec.channelnames.end() ? -1 : static_cast<int>(it - spec.channelnames.begin());
  };
  const int y = find("Y");
  if (y >= 0 && find("RY") < 0 && find("BY") < 0) return {y, y, y};
  return {find("R"), find("G"), find("B")};
}

/// Copies the data window into the display window; `orientation` as in TIFF: 2 to 4 are mirrored.
RadianceMap place(const OIIO::ImageSpec& spec, int orientation, const std::vector<Rgb>& data) {
  RadianceMap map;
  map.width = static_cast<std::size_t>(spec.full_width);
  map.height = static_cast<std::size_t>(spec.full_height);
  map.pixels.assign(map.width * map.height, Rgb(0.0f));
  const bool mirror_x = orientation == 2 || orientation == 3, mirror_y = orientation == 3 || orientation == 4;
  for (int y = 0; y < spec.height; ++y) {
    for (int x = 0; x < spec.width; ++x) {
      int to_x = spec.x + x - spec.full_x, to_y = spec.y + y - spec.full_y;
      if (to_x < 0 || to_y < 0 || to_x >= spec.full_width || to_y >= spec.full_height) continue;
      if (mirror_x) to_x = spec.full_width - 1 - to_x;
      if (mirror_y) to_y = spec.full_height - 1 - to_y;
      map.pixels[static_cast<std::size_t>(to_y) * map.width + static_cast<std::size_t>(to_x)] =
          data[static_cast<std::size_t>(y) * static_cast<std::size_t>(spec.width) + static_cast<std::size_t>(x)];
    }
  }
  return map;
}

Result<RadianceMap> read_map_with(OIIO::ImageInput& input, const std::string& file) {
  OIIO::ImageSpec spec;
  if (!input.open(file, spec)) return broken(file, input.geterror());
  const auto too_large = [](int width, int height) {
    return width < 1 || height < 1 || width > kMaxMapSide || height > kMaxMapSide ||
           std::int64_t{width} * std::int64_t{height} > kMaxMapPixels;
  };
  if (too_large(spec.width, spec.height) || too_large(spec.full_width, spec.full_height)) {
    return broken(file, "image is " + std::to_string(spec.full_width) + " x " + std::to_string(spec.full_height) +
                            " pixels; expected 1 to 2^27 of them, no side above 65536");
  }
  const auto strip_rows = static_cast<std::uint64_t>(std::max(64, spec.tile_height));
  const auto row_pixels = static_cast<std::uint64_t>(std::max(spec.width, spec.tile_width));
  if (spec.nchannels > 1024 || row_pixels * strip_rows * spec.pixel_bytes(true) > kMaxStripBytes) {
    return broken(file, "image has too many channels or too large tiles");
  }
  const auto channels = colour_channels(spec);
  if (spec.deep || std::min({channels[0], channels[1], channels[2]}) < 0) {
    return broken(file, "image has no R, G, B channels; expected a lat-long map of them, or of Y alone");
  }
  const int orientation = spec.get_int_attribute("Orientation", 1);
  if (orientation > 4) return broken(file, "image is stored column by column; expected rows (\"-Y height +X width\")");

  std::vector<Rgb> data(static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height));
  const bool adjacent = channels[1] == channels[0] + 1 && channels[2] == channels[0] + 2;
  const auto read = [&](int first, int count, float* to) {
    return input.read_image(0, 0, first, first + count, OIIO::TypeFloat, to, sizeof(Rgb));
  };
  bool done = true;
  if (adjacent) {
    done = read(channels[0], 3, &data[0].x);
  } else {
    for (int c = 0; c < 3 && done; ++c) done = read(channels[static_cast<std::size_t>(c)], 1, &data[0].x + c);
  }
  if (!done) return broken(file, input.geterror());
  const bool whole = spec.x == spec.full_x && spec.y == spec.full_y && spec.width == spec.full_width &&
                     spec.height == spec.full_height && orientation == 1;
  if (whole) {
    return RadianceMap{static_cast<std::size_t>(spec.width), static_cast<std::size_t>(spec.height), std::move(data)};
  }
  return place(spec, orientation, data);
}

}  // namespace

Result<void> decode_image(std::span<const std::uint8_t> encoded, const std::string& name, const RowSink& sink) {
  const auto header = read_image_header(encoded, name);
  if (!header) return tl::unexpected(header.error());
  try {
    const auto input = OIIO::ImageInput::create(plugin(header->format));
    if (!input) return broken(name, "this OpenImageIO cannot read " + std::string(plugin(header->format)));
    return decode_with(*input, encoded, name, sink);
  } catch (const std::exception& e) {
    return broken(name, e.what());
  }
}

Result<RadianceMap> read_radiance_map(const std::string& file) {
  std::array<char, 4> magic{};
  if (std::ifstream stream(file, std::ios::binary); !stream.read(magic.data(), 4)) {
    return broken(file, "cannot be read; expected a Radiance .hdr or an OpenEXR file");
  }
  const bool hdr = magic[0] == '#' && magic[1] == '?';
  const bool exr = magic == std::array<char, 4>{'\x76', '\x2f', '\x31', '\x01'};
  if (!hdr && !exr) return broken(file, "unknown image format; expected a Radiance .hdr or an OpenEXR file");
  try {
    const auto input = OIIO::ImageInput::create(hdr ? "hdr" : "openexr");
    if (!input) return broken(file, "this OpenImageIO reads neither .hdr nor .exr");
    return read_map_with(*input, file);
  } catch (const std::exception& e) {
    return broken(file, e.what());
  }
}

}  // namespace pf
