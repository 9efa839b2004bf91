#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/base/result.h"
#include "worker/scene/gltf_report.h"

namespace pf::gltf {

using Json = nlohmann::json;
using Bytes = std::vector<std::uint8_t>;

/// Opens the files that a glTF document names, and none outside its root folder.
class Folder {
 public:
  /// `base`: where relative URIs start. `root`: must contain whatever is opened. Both empty: nothing can be
  /// opened.
  Folder(std::filesystem::path base, std::filesystem::path root) : base_(std::move(base)), root_(std::move(root)) {}

  /// Path of a relative URI (percent-decoded); refuses schemes, absolute paths, anything outside the root,
  /// and what is not a regular file. The error text has no place in it: the caller knows the JSON pointer.
  [[nodiscard]] tl::expected<std::filesystem::path, std::string> resolve(std::string_view uri) const;

 private:
  std::filesystem::path base_;
  std::filesystem::path root_;
};

/// First `limit` bytes of a regular file.
[[nodiscard]] tl::expected<Bytes, std::string> read_file(const std::filesystem::path& file, std::uint64_t limit);

/// True when `path` lies in the existing folder `root` or is it, symbolic links and `..` resolved in both.
[[nodiscard]] bool is_inside(const std::filesystem::path& path, const std::filesystem::path& root);

[[nodiscard]] bool is_data_uri(std::string_view uri);

struct DataUri {
  std::string media_type;  ///< "image/png"; may be empty
  Bytes bytes;
};
/// Decodes `data:<type>[;parameter];base64,...`.
[[nodiscard]] tl::expected<DataUri, std::string> decode_data_uri(std::string_view uri);

/// A document split into its parts; `bin` points into the bytes given to split().
struct Container {
  Json document;
  std::optional<std::span<const std::uint8_t>> bin;
  bool binary = false;
};
/// Limits (size, nesting), the GLB frame, and JSON syntax.
[[nodiscard]] Result<Container> split(std::span<const std::uint8_t> bytes, Report& report);

/// No file larger than this is read: a GLB's length field has 32 bits.
inline constexpr std::uint64_t kMaxFileBytes = 0xffffffffu;
/// Deeper JSON is refused: parsers and writers recurse. Real files stay below 20.
inline constexpr int kMaxJsonDepth = 128;

}  // namespace pf::gltf
