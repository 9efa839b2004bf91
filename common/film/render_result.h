#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/film/figures.h"
#include "common/film/film.h"

namespace pf {

/// An image written while its job went on, and what had been spent on it by then.
struct RenderSnapshot : SnapshotFigures {
  std::filesystem::path exr;  ///< beauty alone
  std::uint64_t sub_passes = 0;
};

/// Figures of a finished (or stopped) job, and where its files lie. One machine and the farm write the same.
struct RenderResult : WorkFigures {
  std::filesystem::path exr, png, json;
  std::string image_hash;  ///< SHA-256 of the beauty's floats: equal images, equal hashes
  double load_seconds = 0, prepare_seconds = 0, render_seconds = 0, write_seconds = 0;
  double error = 0;
  std::vector<std::string> warnings;
  std::vector<RenderSnapshot> snapshots;
};

/// What a result says about its job.
struct ResultLabels {
  std::string name;    ///< of the files
  float exposure = 0;  ///< stops, for the PNG
  std::string spec_hash, scene_hash, plan, spec_json;
  std::string files;  ///< of the scene: FileList as JSON (common/wire/bundle.h)
  std::uint64_t seed = 0;
};

/// Names of a job's files in a folder.
struct OutputPaths {
  std::filesystem::path exr, png, json, checkpoint;
  OutputPaths(const std::filesystem::path& folder, const std::string& name)
      : exr(folder / (name + ".exr")),
        png(folder / (name + ".png")),
        json(folder / (name + ".json")),
        checkpoint(folder / (name + ".checkpoint")) {}
};

/// Writes EXR and PNG of the image so far and fills in what the film knows: paths, hash, counts, error, warnings of
/// left-out contributions. Errors: kInternal.
[[nodiscard]] Result<void> write_images(const Film& film, const ResultLabels& labels,
                                        const std::filesystem::path& folder, RenderResult& result);
/// The result as the JSON document that `--json` prints and that stands beside the image.
[[nodiscard]] std::string result_json(const std::string& name, const RenderResult& result);
/// Why a job with overflowed sums fails.
[[nodiscard]] std::string overflow_message(const std::string& name, std::uint64_t overflows);

}  // namespace pf
