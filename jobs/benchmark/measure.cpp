// What a run leaves in its folder: run.json (how it ended) and errors.json (how far its images are from the reference).

#include <limits>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/film/flip.h"
#include "common/film/metrics.h"
#include "jobs/benchmark/analysis.h"
#include "jobs/benchmark/machine.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::uint64_t kMaxText = std::uint64_t{1} << 24;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

json read_json(const fs::path& file) {
  const auto text = read_file(file, kMaxText);
  return text ? json::parse(*text, nullptr, false) : json();
}

double number(const json& object, const char* name) {
  return object.contains(name) && object[name].is_number() ? object[name].get<double>() : kNone;
}

Sample sample_of(const json& s, const fs::path& folder) {
  Sample sample;
  static_cast<SnapshotFigures&>(sample) = snapshot_figures(s);
  sample.exr = folder / fs::path(s.value("exr", std::string())).filename();
  return sample;
}

json measured(const Sample& sample, const Reference& reference) {
  const auto image = read_beauty(sample.exr);
  if (!image) return {{"error", image.error().message}};
  if (image->width != reference.width || image->height != reference.height) {
    return {{"error", fmt::format("{}x{} pixels where the reference has {}x{}", image->width, image->height,
                                  reference.width, reference.height)}};
  }
  const ErrorMetrics m = compare_pixels(image->pixels, reference.mean);
  json errors = {{"nonfinite_pixels", m.image.nonfinite}, {"negative_pixels", m.image.negative}};
  if (!m.finite()) return errors;
  errors.update({{"rel_mse", m.relative_mse},
                 {"rel_mse_trimmed", m.relative_mse_trimmed},
                 {"rmse", m.rmse},
                 {"mean_ratio", m.mean_ratio},
                 {"hdr_flip", hdr_flip(image->pixels, reference.mean, image->width, image->height).mean}});
  return errors;
}

void fill_in(Sample& sample, const json& errors, const Reference& reference) {
  sample.rel_mse = number(errors, "rel_mse");
  sample.rel_mse_trimmed = number(errors, "rel_mse_trimmed");
  sample.rmse = number(errors, "rmse");
  sample.hdr_flip = number(errors, "hdr_flip");
  sample.mean_ratio = number(errors, "mean_ratio");
  sample.nonfinite_pixels = errors.value("nonfinite_pixels", std::uint64_t{0});
  sample.negative_pixels = errors.value("negative_pixels", std::uint64_t{0});
  sample.rel_mse_corrected = sample.rel_mse - reference.noise;
  sample.at_reference_noise = sample.rel_mse_corrected <= reference.noise;
}

}  // namespace

std::optional<RunResult> read_run(const Run& run) {
  const json stored = read_json(run.order.out / "run.json");
  if (!stored.is_object() || stored.value("id", "") != run.id) return std::nullopt;
  RunResult result;
  result.run = &run;
  result.error = stored.value("error", "");
  result.wall_seconds = stored.value("wall_seconds", 0.0);
  if (stored.contains("load_average") && stored["load_average"].is_array()) {
    result.load_average = stored["load_average"][0].get<double>();
  }
  const json figures = stored.value("figures", json::object());
  if (!figures.is_object()) return result;
  const json seconds = figures.value("seconds", json::object());
  result.load_seconds = seconds.value("load", 0.0);
  result.prepare_seconds = seconds.value("prepare", 0.0);
  result.warnings = figures.value("warnings", std::vector<std::string>());
  for (const json& s : figures.value("snapshots", json::array())) result.samples.push_back(sample_of(s, run.order.out));
  if (result.error.empty() && result.samples.empty()) result.error = "left no image";
  return result;
}

Result<void> write_run(const Run& run, const RenderOutcome& outcome, const Suite& suite, const Scene& scene) {
  const json stored = {{"id", run.id},
                       {"scene", scene.name},
                       {"method", suite.methods[run.method].name},
                       {"seed", run.seed},
                       {"error", outcome.error},
                       {"wall_seconds", outcome.wall_seconds},
                       {"load_average", load_averages()},
                       {"figures", outcome.figures}};
  return write_file_atomically(run.order.out / "run.json",
                               stored.dump(2, ' ', false, json::error_handler_t::replace) + "\n");
}

Result<void> measure(RunResult& result, const Reference& reference) {
  if (!reference.error.empty()) {
    for (Sample& sample : result.samples) fill_in(sample, json::object(), reference);
    return {};
  }
  const fs::path file = result.run->order.out / "errors.json";
  json stored = read_json(file);
  const bool known = stored.is_object() && stored.value("reference", "") == reference.key() &&
                     stored["samples"].size() == result.samples.size();
  if (!known) {
    stored = {{"reference", reference.key()}, {"samples", json::array()}};
    for (const Sample& sample : result.samples) stored["samples"].push_back(measured(sample, reference));
    if (!result.samples.empty()) {
      if (auto written = write_file_atomically(file, stored.dump(2) + "\n"); !written) return written;
    }
  }
  for (std::size_t i = 0; i < result.samples.size(); ++i) {
    fill_in(result.samples[i], stored["samples"][i], reference);
    const std::string wrong = stored["samples"][i].value("error", "");
    if (!wrong.empty() && result.error.empty()) result.error = wrong;
  }
  return {};
}

}  // namespace pf::bench
