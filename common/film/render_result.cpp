#include "common/film/render_result.h"

#include <cmath>
#include <span>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "build_id.h"
#include "common/base/hash.h"

namespace pf {

Result<void> write_images(const Film& film, const ResultLabels& labels, const std::filesystem::path& folder,
                          RenderResult& result) {
  const OutputPaths paths(folder, labels.name);
  const Statistics& sums = film.sums();
  // Row by row: beside the film itself no image is ever in memory.
  ImageRows image = film.image_rows();
  result.error = film.estimated_error();
  result.passes = film.order().mean_passes(sums.sub_passes);
  result.rounds = film.rounds();
  result.photon_paths = sums.photon_paths;
  result.photons_stored = sums.photons_stored;
  result.rays = sums.rays;
  if (sums.faults.not_finite > 0) {
    result.warnings.push_back(
        fmt::format("{} contributions were NaN or infinite and are missing in the image", sums.faults.not_finite));
  }
  image.metadata = {{"job", labels.name},
                    {"spec_hash", labels.spec_hash},
                    {"scene_hash", labels.scene_hash},
                    {"seed", fmt::format("{}", labels.seed)},
                    {"passes", fmt::format("{}", result.passes)},
                    {"rounds", fmt::format("{}", result.rounds)},
                    {"photons", fmt::format("{}", result.photon_paths)},
                    {"state_chain", film.state_chain()},
                    {"files", labels.files},
                    {"build_id", kBuildId},
                    {"plan", labels.plan},
                    {"spec", labels.spec_json}};
  // Hashed on its way into the file: no pixel of an open round is worked out more often than it is written.
  Sha256 hash;
  ImageRows hashed = image;
  hashed.rows = [&](int first, int count) {
    std::vector<Layer> layers = image.rows(first, count);
    hash.update(std::as_bytes(std::span(layers.front().data)));
    return layers;
  };
  if (auto done = write_exr(paths.exr, hashed); !done) return done;
  result.image_hash = hash.hex();
  if (auto done = write_png(paths.png, image, labels.exposure); !done) return done;
  result.exr = paths.exr;
  result.png = paths.png;
  result.json = paths.json;
  return {};
}

std::string result_json(const std::string& name, const RenderResult& r) {
  const auto rate = [&](std::uint64_t count) {
    return r.render_seconds > 0 ? static_cast<double>(count) / r.render_seconds : 0.0;
  };
  nlohmann::json json = {{"job", name},
                         {"exr", r.exr.string()},
                         {"png", r.png.string()},
                         {"image_hash", r.image_hash},
                         {"seconds",
                          {{"load", r.load_seconds},
                           {"prepare", r.prepare_seconds},
                           {"render", r.render_seconds},
                           {"write", r.write_seconds}}},
                         {"rays_per_second", rate(r.rays)},
                         {"photons_per_second", rate(r.photon_paths)},
                         {"warnings", r.warnings},
                         {"build_id", kBuildId}};
  json.update(nlohmann::json(figures_json(r)));
  json["estimated_error"] = std::isfinite(r.error) ? nlohmann::json(r.error) : nlohmann::json(nullptr);
  for (const RenderSnapshot& s : r.snapshots) {
    nlohmann::json snapshot = figures_json(s);
    snapshot["exr"] = s.exr.string();
    json["snapshots"].push_back(std::move(snapshot));
  }
  return json.dump(2) + "\n";
}

std::string overflow_message(const std::string& name, std::uint64_t overflows) {
  return fmt::format(
      "{}: {} contributions exceed the range of the exact sums; a light is more than 10^8 times brighter than "
      "the scene's mean: check its intensity and size",
      name, overflows);
}

}  // namespace pf
