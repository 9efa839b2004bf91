#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "common/base/result.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// Which glTF 2.0 file to read, and what of it.
struct GltfRequest {
  std::filesystem::path file;  ///< .gltf or .glb, told apart by content
  /// Nothing outside this folder is opened, symbolic links and `..` resolved. Empty: the file's own folder.
  std::filesystem::path root{};
  std::string scene{};   ///< name or index; empty: the file's default scene, else its first
  std::string camera{};  ///< must name a camera of that scene; empty: not asked for
};

/// Reads a scene into plain, checked data: world space, rest pose (skins and default morph weights applied).
/// A broken file ends in kInvalidInput `file: /json/pointer: what; expected`, or, where its fault cannot
/// touch the image, in a line of SceneDescription::warnings. Extensions in `extensionsRequired` that are not
/// supported are refused before anything is decoded; others give one warning each. Textures are named or kept
/// encoded, not decoded.
[[nodiscard]] Result<SceneDescription> load_gltf(const GltfRequest& request);

/// Same for a file's bytes already in memory; `folder` is where relative URIs lead and what they may not
/// leave (empty: external files are refused).
[[nodiscard]] Result<SceneDescription> load_gltf_from_memory(std::span<const std::uint8_t> bytes,
                                                             const std::filesystem::path& folder);

/// True when something shines: punctual lights, an emitting (or unlit) surface that is placed, or an
/// environment.
[[nodiscard]] bool has_light(const SceneDescription& scene);

}  // namespace pf
