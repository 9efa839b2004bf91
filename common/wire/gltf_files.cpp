#include "common/wire/gltf_files.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/base/uri.h"

namespace pf {
namespace {

using Json = nlohmann::json;

constexpr std::uint64_t kMaxFileBytes = 0xffffffffu;  // a GLB's length field has 32 bits
constexpr int kMaxJsonDepth = 128;
constexpr std::size_t kGlbHeaderBytes = 20;  // of the file, and of its first chunk
constexpr std::size_t kShown = 80;

/// For messages: one line, not too long.
std::string shown(std::string_view text) {
  std::string out;
  for (const char c : text.substr(0, kShown)) out += static_cast<unsigned char>(c) < 0x20 ? '?' : c;
  return "'" + out + (text.size() > kShown ? "...'" : "'");
}

tl::expected<std::string, std::string> json_text(const std::filesystem::path& file) {
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(file, error);
  std::ifstream stream(file, std::ios::binary);
  if (error || !stream) return tl::unexpected<std::string>("cannot be read");
  if (size > kMaxFileBytes) return tl::unexpected<std::string>("is larger than 4 GiB");
  std::array<char, kGlbHeaderBytes> header{};
  stream.read(header.data(), header.size());
  std::uint64_t begin = 0;
  std::uint64_t count = size;
  if (stream.gcount() >= 4 && std::memcmp(header.data(), "glTF", 4) == 0) {
    if (stream.gcount() < static_cast<std::streamsize>(header.size()))
      return tl::unexpected<std::string>("GLB header is cut off");
    std::array<std::uint32_t, 4> words{};  // version, length; of the chunk: length, type
    std::memcpy(words.data(), header.data() + 4, sizeof words);
    if (words[0] != 2) return tl::unexpected(fmt::format("GLB version {}; expected 2", words[0]));
    if (std::memcmp(header.data() + 16, "JSON", 4) != 0)
      return tl::unexpected<std::string>("first GLB chunk is not JSON");
    begin = kGlbHeaderBytes;
    count = words[2];
    if (words[1] > size || count + begin > words[1]) return tl::unexpected<std::string>("GLB is cut off");
  }
  std::string text(count, '\0');
  stream.clear();
  stream.seekg(static_cast<std::streamoff>(begin));
  stream.read(text.data(), static_cast<std::streamsize>(count));
  if (static_cast<std::uint64_t>(stream.gcount()) != count) return tl::unexpected<std::string>("ends early");
  return text;
}

tl::expected<Json, std::string> parse(const std::string& text) {
  bool too_deep = false;
  // Json's own comparison and destruction recurse; the loader's bound holds here too.
  const auto look = [&](int depth, Json::parse_event_t, Json&) {
    too_deep |= depth > kMaxJsonDepth;
    return !too_deep;
  };
  try {
    Json document = Json::parse(text, look);
    if (too_deep) return tl::unexpected(fmt::format("JSON is nested deeper than {} levels", kMaxJsonDepth));
    if (!document.is_object()) return tl::unexpected<std::string>("JSON is not an object; expected a glTF document");
    return document;
  } catch (const Json::exception& e) {
    return tl::unexpected("not glTF: " + shown(e.what()));
  }
}

/// The elements of a top-level array; none where it is absent or no array (which the loader will say).
const Json& elements(const Json& object, const char* key) {
  static const Json kNone = Json::array();
  const auto found = object.find(key);
  return found != object.end() && found->is_array() ? *found : kNone;
}

/// Adds the indices of all textures that a part of a material uses.
void find_textures(const Json& part, std::set<std::uint64_t>& textures) {
  if (!part.is_structured()) return;
  for (const auto& item : part.items()) {
    const Json& value = item.value();
    if (part.is_object() && item.key().ends_with("Texture") && value.is_object()) {
      if (const auto index = value.find("index"); index != value.end() && index->is_number_unsigned()) {
        textures.insert(index->get<std::uint64_t>());
      }
    }
    find_textures(value, textures);
  }
}

std::set<std::uint64_t> used_images(const Json& document) {
  std::set<std::uint64_t> textures;
  for (const Json& material : elements(document, "materials")) find_textures(material, textures);
  std::set<std::uint64_t> images;
  const Json& all = elements(document, "textures");
  for (const std::uint64_t texture : textures) {
    if (texture >= all.size()) continue;
    const Json& t = all[static_cast<std::size_t>(texture)];
    static const Json::json_pointer kWebp("/extensions/EXT_texture_webp/source");
    static const Json::json_pointer kSource("/source");
    // WebP comes before the source that stands in for it, as in the loader.
    for (const Json::json_pointer& place : {kWebp, kSource}) {
      if (!t.is_object() || !t.contains(place) || !t[place].is_number_unsigned()) continue;
      images.insert(t[place].get<std::uint64_t>());
      break;
    }
  }
  return images;
}

}  // namespace

tl::expected<std::vector<GltfUri>, std::string> gltf_uris(const std::filesystem::path& file) {
  const auto text = json_text(file);
  if (!text) return tl::unexpected(text.error());
  std::string_view json = *text;
  const auto document = parse(json.starts_with("\xef\xbb\xbf") ? text->substr(3) : *text);
  if (!document) return tl::unexpected(document.error());
  const std::set<std::uint64_t> used = used_images(*document);
  std::vector<GltfUri> uris;
  for (const char* kind : {"buffers", "images"}) {
    const Json& all = elements(*document, kind);
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!all[i].is_object() || !all[i].contains("uri")) continue;
      const std::string place = fmt::format("/{}/{}/uri", kind, i);
      const Json& uri = all[i]["uri"];
      if (!uri.is_string()) return tl::unexpected(place + " is no text; expected a URI");
      const auto& value = uri.get_ref<const std::string&>();
      if (value.starts_with("data:")) continue;
      uris.push_back({value, place, std::string_view(kind) == "buffers" || used.contains(i)});
    }
  }
  return uris;
}

tl::expected<std::string, std::string> gltf_file_name(std::string_view uri) {
  if (has_scheme(uri)) {
    return tl::unexpected(fmt::format("URI {} has a scheme; expected a relative path or a data: URI", shown(uri)));
  }
  std::string name = percent_decoded(uri);
  const bool control =
      std::any_of(name.begin(), name.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; });
  if (name.empty() || control) return tl::unexpected(fmt::format("URI {} is not a file name", shown(uri)));
  if (name.front() == '/' || name.front() == '\\') {
    return tl::unexpected(fmt::format("URI {} is absolute; expected a path relative to the file", shown(uri)));
  }
  return name;
}

}  // namespace pf
