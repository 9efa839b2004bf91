#include <algorithm>
#include <exception>
#include <filesystem>
#include <new>

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfTileDescription.h>
#include <fmt/format.h>

#include "common/film/image.h"

namespace pf {
namespace {

/// Rows decoded at a time: the largest chunk of any compression (DWAB), so that none is decoded twice.
constexpr int kRowsAtOnce = 256;

[[nodiscard]] tl::unexpected<Error> unreadable(const std::string& what) { return fail(ErrorKind::kInvalidInput, what); }

/// Where a channel of the file goes.
struct Target {
  std::string file_name;
  std::size_t layer = 0;
  std::size_t index = 0;
};

/// R, G, B, then everything else by name, then A.
[[nodiscard]] std::pair<int, std::string> channel_order(const std::string& channel) {
  const std::string_view known = "RGB";
  const std::size_t place = channel.size() == 1 ? known.find(channel) : std::string_view::npos;
  if (place != std::string_view::npos) return {static_cast<int>(place), channel};
  return {channel == "A" ? 4 : 3, channel};
}

/// Groups channels `<layer>.<channel>` into the layers of `image`, still without pixels.
[[nodiscard]] std::vector<Target> lay_out(const Imf::ChannelList& channels, LayeredImage& image) {
  std::map<std::string, std::vector<std::pair<std::string, std::string>>> layers;  // layer -> (channel, full name)
  for (auto it = channels.begin(); it != channels.end(); ++it) {
    const std::string name = it.name();
    const std::size_t dot = name.rfind('.');
    if (dot == std::string::npos || dot == 0 || dot + 1 == name.size()) {
      layers[""].emplace_back(name, name);
    } else {
      layers[name.substr(0, dot)].emplace_back(name.substr(dot + 1), name);
    }
  }
  std::vector<Target> targets;
  for (auto& [layer_name, members] : layers) {
    std::ranges::sort(members, {}, [](const auto& member) { return channel_order(member.first); });
    Layer layer{layer_name, {}, {}};
    for (const auto& [channel, full_name] : members) {
      targets.push_back({full_name, image.layers.size(), layer.channels.size()});
      layer.channels.push_back(channel);
    }
    image.layers.push_back(std::move(layer));
  }
  return targets;
}

/// Width and height of a window, 64 bits wide because a damaged header may hold any corners.
struct Extent {
  std::int64_t width = 0;
  std::int64_t height = 0;
};
[[nodiscard]] Extent extent(const Imath::Box2i& window) {
  return {std::int64_t{window.max.x} - window.min.x + 1, std::int64_t{window.max.y} - window.min.y + 1};
}

[[nodiscard]] Result<void> check_window(const Imath::Box2i& window, std::string_view name, std::size_t channels) {
  const auto [width, height] = extent(window);
  if (width <= 0 || height <= 0) return unreadable(fmt::format("the {} window is empty", name));
  if (width > kMaxImageEdge || height > kMaxImageEdge ||
      static_cast<std::uint64_t>(width * height) * channels > kMaxImageFloats) {
    return unreadable(
        fmt::format("the {} window has {}x{} pixels of {} channels; at most {} pixels an edge and {} "
                    "values are read",
                    name, width, height, channels, kMaxImageEdge, kMaxImageFloats));
  }
  return {};
}

[[nodiscard]] Result<void> check_header(const Imf::Header& header) {
  if (header.hasType() && header.type() != Imf::SCANLINEIMAGE && header.type() != Imf::TILEDIMAGE) {
    return unreadable(fmt::format("holds '{}'; expected a flat image, '{}' or '{}'", header.type(), Imf::SCANLINEIMAGE,
                                  Imf::TILEDIMAGE));
  }
  std::size_t channels = 0;
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) ++channels;
  if (channels == 0) return unreadable("has no channels");
  if (auto ok = check_window(header.displayWindow(), "display", channels); !ok) return ok;
  if (auto ok = check_window(header.dataWindow(), "data", channels); !ok) return ok;
  if (header.hasTileDescription()) {
    const Imf::TileDescription& tile = header.tileDescription();
    if (tile.xSize > kMaxImageEdge || tile.ySize > kMaxImageEdge ||
        std::uint64_t{tile.xSize} * tile.ySize * channels > kMaxImageFloats) {
      return unreadable(fmt::format("has tiles of {}x{} pixels", tile.xSize, tile.ySize));
    }
  }
  return {};
}

[[nodiscard]] bool has_chroma(const Imf::ChannelList& channels) {
  return channels.findChannel("Y") != nullptr && channels.findChannel("RY") != nullptr &&
         channels.findChannel("BY") != nullptr;
}
[[nodiscard]] bool is_subsampled(const Imf::ChannelList& channels) {
  for (auto it = channels.begin(); it != channels.end(); ++it) {
    if (it.channel().xSampling != 1 || it.channel().ySampling != 1) return true;
  }
  return false;
}

/// The rectangle in which data and display window overlap, in coordinates of the file; may be empty.
[[nodiscard]] Imath::Box2i overlap(const Imf::Header& header) {
  const Imath::Box2i& data = header.dataWindow();
  const Imath::Box2i& display = header.displayWindow();
  return {{std::max(data.min.x, display.min.x), std::max(data.min.y, display.min.y)},
          {std::min(data.max.x, display.max.x), std::min(data.max.y, display.max.y)}};
}

using LayerChoice = std::optional<std::string>;
[[nodiscard]] bool is_chosen(const Layer& layer, const LayerChoice& only) { return !only || layer.name == *only; }

void allocate(LayeredImage& image, const LayerChoice& only = {}) {
  for (Layer& layer : image.layers) {
    if (is_chosen(layer, only)) layer.data.assign(layer.channels.size() * image.width * image.height, 0.0f);
  }
}

[[nodiscard]] LayeredImage read_layers(Imf::MultiPartInputFile& input, LayeredImage image, const LayerChoice& only) {
  const Imf::Header& header = input.header(0);
  std::vector<Target> targets = lay_out(header.channels(), image);
  std::erase_if(targets, [&](const Target& target) { return !is_chosen(image.layers[target.layer], only); });
  if (targets.empty()) return image;
  const Imath::Box2i data = header.dataWindow();
  const Imath::V2i origin = header.displayWindow().min;
  const Imath::Box2i wanted = overlap(header);
  const int columns = data.max.x - data.min.x + 1;
  const int step = header.hasTileDescription() ? static_cast<int>(header.tileDescription().ySize) : kRowsAtOnce;
  const std::size_t plane = std::size_t{1} * columns * std::min(step, data.max.y - data.min.y + 1);
  Imf::InputPart part(input, 0);
  std::vector<float> rows(plane * targets.size());
  bool allocated = false;
  for (std::int64_t block = data.min.y; block <= data.max.y; block += step) {
    const int first = static_cast<int>(std::max<std::int64_t>(block, wanted.min.y));
    const int last = static_cast<int>(std::min<std::int64_t>(block + step - 1, wanted.max.y));
    if (first > last || wanted.min.x > wanted.max.x) continue;
    Imf::FrameBuffer frame;
    for (std::size_t t = 0; t < targets.size(); ++t) {
      frame.insert(targets[t].file_name, Imf::Slice::Make(Imf::FLOAT, rows.data() + plane * t, {data.min.x, first},
                                                          columns, last - first + 1));
    }
    part.setFrameBuffer(frame);
    part.readPixels(first, last);
    // Only once a first block has proved to be there: a short file with a huge header stays cheap.
    if (!allocated) allocate(image, only);
    allocated = true;
    for (std::size_t t = 0; t < targets.size(); ++t) {
      Layer& layer = image.layers[targets[t].layer];
      for (int y = first; y <= last; ++y) {
        const float* from = rows.data() + plane * t + std::size_t{1} * columns * (y - first);
        float* to = layer.data.data() + targets[t].index;
        for (int x = wanted.min.x; x <= wanted.max.x; ++x) {
          to[((std::size_t{1} * (y - origin.y)) * image.width + (x - origin.x)) * layer.channels.size()] =
              from[x - data.min.x];
        }
      }
    }
  }
  if (!allocated) allocate(image, only);
  return image;
}

/// Luminance and chroma at half resolution, turned into RGB by OpenEXR.
[[nodiscard]] Result<LayeredImage> read_chroma(const std::filesystem::path& file, LayeredImage image) {
  Imf::RgbaInputFile input(file.c_str(), 0);
  const Imath::Box2i data = input.dataWindow();
  const Imath::V2i origin = input.displayWindow().min;
  const Imath::Box2i wanted = overlap(input.header());
  const bool alpha = (input.channels() & Imf::WRITE_A) != 0;
  if ((input.channels() & Imf::WRITE_YC) != Imf::WRITE_YC) {
    return unreadable("has subsampled channels; expected all channels in full, or luminance and chroma Y, RY, BY");
  }
  const std::size_t columns = std::size_t{1} * (data.max.x - data.min.x + 1);
  std::vector<Imf::Rgba> pixels(columns * (data.max.y - data.min.y + 1));
  input.setFrameBuffer(Imf::ComputeBasePointer(pixels.data(), data), 1, columns);
  input.readPixels(data.min.y, data.max.y);
  Layer layer{"", alpha ? std::vector<std::string>{"R", "G", "B", "A"} : std::vector<std::string>{"R", "G", "B"}, {}};
  const std::size_t channels = layer.channels.size();
  image.layers.push_back(std::move(layer));
  allocate(image);
  for (int y = wanted.min.y; y <= wanted.max.y; ++y) {
    for (int x = wanted.min.x; x <= wanted.max.x; ++x) {
      const Imf::Rgba& pixel = pixels[columns * (y - data.min.y) + (x - data.min.x)];
      float* to =
          image.layers[0].data.data() + (std::size_t{1} * (y - origin.y) * image.width + (x - origin.x)) * channels;
      to[0] = pixel.r;
      to[1] = pixel.g;
      to[2] = pixel.b;
      if (alpha) to[3] = pixel.a;
    }
  }
  return image;
}

[[nodiscard]] Result<LayeredImage> read_file_of_layers(const std::filesystem::path& file, const LayerChoice& only) {
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) return unreadable("no such file");
  if (!std::filesystem::is_regular_file(file, ignored)) return unreadable("not a regular file");
  // Without rebuilding a lost table of chunks: a file that was cut short is an error, not half an image.
  Imf::MultiPartInputFile input(file.c_str(), 0, false);
  if (input.parts() < 1) return unreadable("has no parts");
  const Imf::Header& header = input.header(0);
  if (auto ok = check_header(header); !ok) return tl::unexpected(ok.error());
  LayeredImage image;
  const auto [width, height] = extent(header.displayWindow());
  image.width = static_cast<int>(width);
  image.height = static_cast<int>(height);
  for (auto it = header.begin(); it != header.end(); ++it) {
    const auto* text = dynamic_cast<const Imf::StringAttribute*>(&it.attribute());
    const std::string_view name = it.name();
    if (text == nullptr || !name.starts_with(kExrAttributePrefix)) continue;
    image.metadata.emplace(name.substr(kExrAttributePrefix.size()), text->value());
  }
  if (has_chroma(header.channels()) || is_subsampled(header.channels())) return read_chroma(file, std::move(image));
  return read_layers(input, std::move(image), only);
}

}  // namespace

Result<LayeredImage> read_exr(const std::filesystem::path& file, const std::optional<std::string>& only) {
  std::string what;
  try {
    Result<LayeredImage> image = read_file_of_layers(file, only);
    if (image) return image;
    what = image.error().message;
  } catch (const std::bad_alloc&) {
    what = "not enough memory for this image";
  } catch (const std::exception& error) {
    what = fmt::format("not a readable OpenEXR image: {}", error.what());
  }
  return fail(ErrorKind::kInvalidInput, fmt::format("{}: {}", file.string(), what));
}

}  // namespace pf
