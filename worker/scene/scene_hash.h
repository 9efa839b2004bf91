#pragma once

#include <filesystem>
#include <string>

#include "common/base/result.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// SHA-256 (hex) of everything that a scene's image can depend on: the glTF file's bytes, the decoded geometry (so the
/// external buffers), texture and environment files. Two descriptions of equal hash render alike with the same spec.
[[nodiscard]] Result<std::string> hash_scene(const std::filesystem::path& gltf, const SceneDescription& description);

}  // namespace pf
