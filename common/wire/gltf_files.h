#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

namespace pf {

// Which files a glTF document names: as much as must be known to send a scene to a farm. Rules as in
// worker/scene/gltf_source.h, which opens them; a test holds the two against each other's examples.

struct GltfUri {
  std::string uri;
  std::string place;   ///< JSON pointer
  bool needed = true;  ///< false: an image that no material uses; the loader goes on without it
};

/// URIs of the buffers and images of a .gltf or .glb file (told apart by content), data: URIs left out.
/// Errors have no place in them: the caller knows the file.
[[nodiscard]] tl::expected<std::vector<GltfUri>, std::string> gltf_uris(const std::filesystem::path& file);

/// The relative file name that a URI stands for, percent-decoded. Refuses schemes, absolute paths and control
/// characters.
[[nodiscard]] tl::expected<std::string, std::string> gltf_file_name(std::string_view uri);

}  // namespace pf
