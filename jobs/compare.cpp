#include "jobs/compare.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/film/flip.h"
#include "common/film/image.h"
#include "common/film/metrics.h"

namespace pf {
namespace {

/// Figures of one layer that both images have; its non-finite pixels leave figures empty but are no error.
struct LayerComparison {
  std::string name;
  ErrorMetrics metrics;
};

struct Comparison {
  int width = 0;
  int height = 0;
  std::vector<Rgb> image, reference;
  ErrorMetrics metrics;
  FlipMap ldr;
  HdrFlipMap hdr;
  std::vector<LayerComparison> layers;
};

[[nodiscard]] Result<std::vector<Rgb>> read_beauty(const std::filesystem::path& file, LayeredImage& image) {
  auto read = read_exr(file);
  if (!read) return tl::unexpected(read.error());
  image = std::move(*read);
  const Layer* beauty = image.find("");
  if (beauty == nullptr) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: no channels R, G, B; only named layers", file.string()));
  }
  auto pixels = rgb_pixels(*beauty);
  if (!pixels) return fail(ErrorKind::kInvalidInput, fmt::format("{}: {}", file.string(), pixels.error().message));
  return pixels;
}

[[nodiscard]] Result<void> check_finite(const std::filesystem::path& file, const ErrorMetrics::Count& count,
                                        int width) {
  if (count.nonfinite == 0) return {};
  const auto [y, x] = std::div(static_cast<long>(count.first_nonfinite), static_cast<long>(width));
  return fail(ErrorKind::kInvalidInput,
              fmt::format("{}: {} pixels are NaN or infinite, the first at x = {}, y = {}; expected finite pixels",
                          file.string(), count.nonfinite, x, y));
}

[[nodiscard]] std::vector<LayerComparison> compare_layers(const LayeredImage& image, const LayeredImage& reference) {
  std::vector<LayerComparison> comparisons;
  for (const Layer& layer : image.layers) {
    const Layer* other = layer.name.empty() ? nullptr : reference.find(layer.name);
    if (other == nullptr) continue;
    const auto a = rgb_pixels(layer);
    const auto b = rgb_pixels(*other);
    if (a && b) comparisons.push_back({layer.name, compare_pixels(*a, *b)});
  }
  return comparisons;
}

[[nodiscard]] Result<Comparison> compare(const CompareOptions& options) {
  LayeredImage image, reference;
  Comparison result;
  if (auto pixels = read_beauty(options.image, image)) {
    result.image = std::move(*pixels);
  } else {
    return tl::unexpected(pixels.error());
  }
  if (auto pixels = read_beauty(options.reference, reference)) {
    result.reference = std::move(*pixels);
  } else {
    return tl::unexpected(pixels.error());
  }
  if (image.width != reference.width || image.height != reference.height) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: {}x{} pixels; expected {}x{} as {} has", options.image.string(), image.width,
                            image.height, reference.width, reference.height, options.reference.string()));
  }
  result.width = image.width;
  result.height = image.height;
  result.metrics = compare_pixels(result.image, result.reference);
  if (auto ok = check_finite(options.image, result.metrics.image, result.width); !ok) {
    return tl::unexpected(ok.error());
  }
  if (auto ok = check_finite(options.reference, result.metrics.reference, result.width); !ok) {
    return tl::unexpected(ok.error());
  }
  result.ldr = ldr_flip(result.image, result.reference, result.width, result.height);
  result.hdr = hdr_flip(result.image, result.reference, result.width, result.height);
  result.layers = compare_layers(image, reference);
  return result;
}

[[nodiscard]] Result<void> write_error_image(const std::filesystem::path& file, const Comparison& result) {
  if (file.extension() == ".png") {
    return write_png(file, result.width, result.height, magma_colors(result.hdr.error));
  }
  Layer squares{"", {"R", "G", "B"}, {}};
  squares.data.reserve(3 * result.image.size());
  for (std::size_t i = 0; i < result.image.size(); ++i) {
    for (int channel = 0; channel < 3; ++channel) {
      const float r = result.reference[i][channel];
      const float difference = result.image[i][channel] - r;
      squares.data.push_back(difference * difference / (r * r + 0.01f));
    }
  }
  return write_exr(file, {result.width, result.height, {std::move(squares), {"flip", {"Y"}, result.hdr.error}}, {}});
}

[[nodiscard]] nlohmann::ordered_json to_json(const ErrorMetrics& metrics) {
  // A figure that does not exist (a ratio to black, a layer with non-finite pixels) is null in JSON.
  return {{"relative_mse", metrics.relative_mse},
          {"relative_mse_trimmed", metrics.relative_mse_trimmed},
          {"rmse", metrics.rmse},
          {"mae", metrics.mae},
          {"smape", metrics.smape},
          {"max_error", metrics.max_error},
          {"mean_ratio", metrics.mean_ratio},
          {"image_nonfinite_pixels", metrics.image.nonfinite},
          {"image_negative_pixels", metrics.image.negative},
          {"reference_nonfinite_pixels", metrics.reference.nonfinite},
          {"reference_negative_pixels", metrics.reference.negative}};
}

[[nodiscard]] std::string json_document(const CompareOptions& options, const Comparison& result) {
  nlohmann::ordered_json document = {{"image", options.image.string()},
                                     {"reference", options.reference.string()},
                                     {"width", result.width},
                                     {"height", result.height}};
  document.update(to_json(result.metrics));
  document["hdr_flip"] = {{"mean", result.hdr.mean},
                          {"start_exposure", result.hdr.start_exposure},
                          {"stop_exposure", result.hdr.stop_exposure},
                          {"exposures", result.hdr.exposures}};
  document["ldr_flip"] = {{"mean", result.ldr.mean}};
  document["layers"] = nlohmann::ordered_json::object();
  for (const LayerComparison& layer : result.layers) document["layers"][layer.name] = to_json(layer.metrics);
  // File names need not be UTF-8; what is not becomes U+FFFD instead of an exception.
  return document.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

[[nodiscard]] std::string table(const CompareOptions& options, const Comparison& result) {
  const ErrorMetrics& m = result.metrics;
  std::string text;
  const auto line = [&text](std::string_view name, const std::string& value) {
    fmt::format_to(std::back_inserter(text), "{:<22}{}\n", name, value);
  };
  const auto number = [](double value) { return fmt::format("{:.6g}", value); };
  line("image", options.image.string());
  line("reference", options.reference.string());
  line("size", fmt::format("{}x{}", result.width, result.height));
  line("relMSE", number(m.relative_mse));
  line("relMSE trimmed", number(m.relative_mse_trimmed) + "   (without the worst 0.1 % of pixels)");
  line("RMSE", number(m.rmse));
  line("MAE", number(m.mae));
  line("SMAPE", number(m.smape));
  line("max error", number(m.max_error));
  line("mean ratio", number(m.mean_ratio));
  line("HDR-FLIP mean", fmt::format("{:.6g}   ({} exposures from {:+.2f} to {:+.2f} stops)", result.hdr.mean,
                                    result.hdr.exposures, result.hdr.start_exposure, result.hdr.stop_exposure));
  line("LDR-FLIP mean", number(result.ldr.mean) + "   (clamped to [0, 1])");
  if (m.image.negative + m.reference.negative > 0) {
    line("negative pixels",
         fmt::format("{} in the image, {} in the reference", m.image.negative, m.reference.negative));
  }
  if (!result.layers.empty()) {
    fmt::format_to(std::back_inserter(text), "\n{:<22}{:<14}{:<16}{:<14}{}\n", "layer", "relMSE", "relMSE trimmed",
                   "RMSE", "mean ratio");
  }
  for (const auto& [name, layer] : result.layers) {
    if (!layer.finite()) {
      line(name, fmt::format("{} NaN or infinite pixels in the image, {} in the reference", layer.image.nonfinite,
                             layer.reference.nonfinite));
      continue;
    }
    fmt::format_to(std::back_inserter(text), "{:<22}{:<14}{:<16}{:<14}{}\n", name, number(layer.relative_mse),
                   number(layer.relative_mse_trimmed), number(layer.rmse), number(layer.mean_ratio));
  }
  return text;
}

}  // namespace

Result<std::string> run_compare(const CompareOptions& options) {
  const std::string extension = options.error_image.extension().string();
  if (!options.error_image.empty() && extension != ".png" && extension != ".exr") {
    return fail(ErrorKind::kUsage, fmt::format("--error-image {}: unknown kind of image; expected .png or .exr",
                                               options.error_image.string()));
  }
  const auto result = compare(options);
  if (!result) return tl::unexpected(result.error());
  if (!options.error_image.empty()) {
    if (auto ok = write_error_image(options.error_image, *result); !ok) return tl::unexpected(ok.error());
  }
  return options.json ? json_document(options, *result) : table(options, *result);
}

}  // namespace pf
