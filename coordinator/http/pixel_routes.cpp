// What the dashboard draws: the layers of a job's image as half floats.

#include <fmt/format.h>

#include <bit>
#include <charconv>
#include <span>
#include <system_error>

#include "coordinator/http/json.h"
#include "coordinator/http/routes.h"

namespace pf {
namespace {

using nlohmann::json;

constexpr int kDefaultWidth = 960;

std::optional<int> width_of(const std::string& text) {
  if (text.empty()) return kDefaultWidth;
  int width = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), width);
  const bool fits = error == std::errc() && end == text.data() + text.size() && width >= 1 && width <= kMaxPixelsWidth;
  return fits ? std::optional(width) : std::nullopt;
}

/// The layer alone: of a large image all of them would be gigabytes.
Result<LayeredImage> read_layer(const std::filesystem::path& exr, const std::string& layer) {
  return read_exr(exr, layer == "beauty" ? std::string() : layer);
}

}  // namespace

HttpReply HttpRoutes::layers(const HttpRequest&, const Captures& captures) {
  auto list = service_.layers(captures[0]);
  if (!list && list.error().kind == ErrorKind::kUnavailable) {
    if (const auto exr = service_.artifact(captures[0], Artifact::kExr)) {
      // A name that no layer has: only the header is read.
      const auto image = read_exr(*exr, "?");
      list = image ? Result<LayerList>(layer_list(rows_of(*image))) : tl::unexpected(image.error());
    }
  }
  if (!list) return failure(list.error(), kNotYet);
  json names = json::array(), channels = json::object();
  for (const LayerList::Entry& entry : list->layers) {
    names.push_back(entry.name);
    channels[entry.name] = entry.channels;
  }
  HttpReply reply;
  reply.headers.emplace_back("Cache-Control", "no-store");
  reply.body = json_line({{"layers", names}, {"channels", channels}, {"width", list->width}, {"height", list->height}});
  return reply;
}

HttpReply HttpRoutes::pixels(const HttpRequest& request, const Captures& captures) {
  const std::string& id = captures[0];
  const std::string layer = request.param("layer").empty() ? "beauty" : request.param("layer");
  const auto width = width_of(request.param("max_width"));
  if (!width)
    return problem(400, "bad-request", fmt::format("max_width: expected a whole number from 1 to {}", kMaxPixelsWidth));
  const auto job = service_.show(id);
  if (!job) return failure(job.error());
  // A job's image is a matter of its sub-passes alone; ended, it lies in a file.
  const bool ended = has_ended(job->state);
  const std::string state = fmt::format("{}-{}", ended ? "end" : "run", job->passes_done);
  const auto made =
      pixel_cache_.get(fmt::format("{}/{}/{}", id, layer, *width), state, !ended, [&]() -> Result<LayerPixels> {
        auto pixels = service_.pixels(id, layer, *width);
        if (pixels || pixels.error().kind != ErrorKind::kUnavailable) return pixels;
        const auto exr = service_.artifact(id, Artifact::kExr);
        if (!exr) return pixels;
        const auto image = read_layer(*exr, layer);
        if (!image) return tl::unexpected(image.error());
        pixels = layer_pixels(rows_of(*image), layer, *width);
        if (pixels) pixels->passes = job->passes_done;
        return pixels;
      });
  if (!made) {
    if (made.error().kind == ErrorKind::kInvalidInput) return problem(400, "bad-request", made.error().message);
    return failure(made.error(), kNotYet);
  }
  const LayerPixels& pixels = **made;
  HttpReply reply;
  reply.content_type = "application/octet-stream";
  const std::string etag = fmt::format("\"{}-{}-{}-{}\"", id, layer, *width, pixels.passes);
  reply.headers = {{"ETag", etag},
                   {"Cache-Control", "no-cache"},
                   {"Photonfarm-Width", std::to_string(pixels.width)},
                   {"Photonfarm-Height", std::to_string(pixels.height)},
                   {"Photonfarm-Passes", std::to_string(pixels.passes)}};
  if (request.header("if-none-match") == etag) {
    reply.status = 304;
    return reply;
  }
  static_assert(std::endian::native == std::endian::little);
  const auto bytes = std::as_bytes(std::span(pixels.rgb));
  reply.body = SharedBytes{*made, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}};
  return reply;
}

}  // namespace pf
