#include "common/film/image.h"

#include <algorithm>

#include <fmt/format.h>

namespace pf {

const Layer* LayeredImage::find(const std::string& name) const {
  const auto it = std::ranges::find(layers, name, &Layer::name);
  return it == layers.end() ? nullptr : &*it;
}

ImageRows rows_of(const LayeredImage& image) {
  const auto rows = [&image](int first, int count) {
    std::vector<Layer> block;
    for (const Layer& layer : image.layers) {
      if (layer.data.empty()) {  // read_exr was asked for another one
        block.push_back(layer);
        continue;
      }
      const auto row = static_cast<std::ptrdiff_t>(layer.channels.size()) * image.width;
      const auto begin = layer.data.begin() + row * first;
      block.push_back({layer.name, layer.channels, {begin, begin + row * count}});
    }
    return block;
  };
  return {image.width, image.height, rows, image.metadata};
}

Result<std::vector<Rgb>> rgb_pixels(const Layer& layer) {
  const auto place = [&](const char* channel) {
    return static_cast<std::size_t>(std::ranges::find(layer.channels, channel) - layer.channels.begin());
  };
  const std::size_t count = layer.channels.size();
  const bool grey = count == 1 && layer.channels[0] == "Y";
  const std::size_t r = grey ? 0 : place("R");
  const std::size_t g = grey ? 0 : place("G");
  const std::size_t b = grey ? 0 : place("B");
  if (std::max({r, g, b}) >= count) {
    return fail(ErrorKind::kInvalidInput, fmt::format("layer '{}' has channels {}; expected R, G, B, or Y alone",
                                                      layer.name, fmt::join(layer.channels, ", ")));
  }
  std::vector<Rgb> pixels;
  pixels.reserve(layer.data.size() / count);
  for (std::size_t i = 0; i + count <= layer.data.size(); i += count) {
    pixels.emplace_back(layer.data[i + r], layer.data[i + g], layer.data[i + b]);
  }
  return pixels;
}

}  // namespace pf
