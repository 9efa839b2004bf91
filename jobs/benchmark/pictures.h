#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "common/base/result.h"
#include "jobs/benchmark/analysis.h"

namespace pf::bench {

/// Tone-mapped images and HDR-FLIP error maps of the last sample of the first repetition of every method, and the
/// references, as PNG below `folder`: <scene>-<method number>.png, <scene>-<method number>-error.png,
/// <scene>-reference.png.
[[nodiscard]] Result<void> write_pictures(const BenchResult& bench, const std::filesystem::path& folder);

[[nodiscard]] std::string picture_name(const SceneResult& scene, std::size_t method, bool error);
[[nodiscard]] std::string reference_picture_name(const SceneResult& scene);

/// The sample that pictures show; nullptr when there is none.
[[nodiscard]] const Sample* pictured(const MethodResult& method);

/// `data:<type>;base64,...` of a file's content; empty when it cannot be read.
[[nodiscard]] std::string data_uri(const std::filesystem::path& file, std::string_view type);

}  // namespace pf::bench
