#include "coordinator/layer_pixels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>

#include <Imath/half.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/base/nearest_name.h"

namespace pf {
namespace {

constexpr std::string_view kBeauty = "beauty";
constexpr std::size_t kRgb = 3;
constexpr float kLargestHalf = HALF_MAX;

std::string_view shown_name(const Layer& layer) { return layer.name.empty() ? kBeauty : std::string_view(layer.name); }

const Layer* find_layer(const std::vector<Layer>& layers, std::string_view name) {
  const auto found = std::ranges::find(layers, name, shown_name);
  return found == layers.end() ? nullptr : &*found;
}

std::uint16_t to_half(float value) {
  return half(std::isnan(value) ? value : std::clamp(value, -kLargestHalf, kLargestHalf)).bits();
}

tl::unexpected<Error> no_such_layer(const std::vector<Layer>& layers, std::string_view name) {
  std::vector<std::string_view> names;
  names.reserve(layers.size());
  for (const Layer& layer : layers) names.push_back(shown_name(layer));
  std::string text =
      fmt::format("layer: the image has no layer \"{}\"; expected one of {}", name, fmt::join(names, ", "));
  if (const auto near = nearest_name(name, std::span<const std::string_view>(names)))
    text += fmt::format("; did you mean {}?", *near);
  return fail(ErrorKind::kInvalidInput, std::move(text));
}

}  // namespace

LayerList layer_list(const ImageRows& image) {
  LayerList list;
  list.width = image.width;
  list.height = image.height;
  for (const Layer& layer : image.rows(0, 1)) list.layers.push_back({std::string(shown_name(layer)), layer.channels});
  return list;
}

Result<LayerPixels> layer_pixels(const ImageRows& image, const std::string& layer, int max_width) {
  const int block = (image.width + max_width - 1) / max_width;
  LayerPixels small;
  small.width = (image.width + block - 1) / block;
  small.height = (image.height + block - 1) / block;
  const auto columns = static_cast<std::size_t>(small.width);
  small.rgb.reserve(kRgb * columns * static_cast<std::size_t>(small.height));
  std::vector<float> sums(kRgb * columns);
  for (int top = 0; top < image.height; top += block) {
    const int rows = std::min(block, image.height - top);
    const std::vector<Layer> layers = image.rows(top, rows);
    const Layer* wanted = find_layer(layers, layer);
    if (wanted == nullptr) return no_such_layer(layers, layer);
    const std::size_t channels = wanted->channels.size();
    std::ranges::fill(sums, 0.0f);
    const float* pixel = wanted->data.data();
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < image.width; ++x, pixel += channels) {
        float* sum = sums.data() + kRgb * static_cast<std::size_t>(x / block);
        for (std::size_t c = 0; c < kRgb; ++c) sum[c] += channels == 1 ? pixel[0] : c < channels ? pixel[c] : 0.0f;
      }
    }
    for (std::size_t i = 0; i < sums.size(); ++i) {
      const int across = std::min(block, image.width - block * static_cast<int>(i / kRgb));
      small.rgb.push_back(to_half(sums[i] / static_cast<float>(across * rows)));
    }
  }
  return small;
}

}  // namespace pf
