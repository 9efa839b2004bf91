#include "worker/scene/gltf_source.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <fstream>
#include <set>
#include <system_error>

#include <fmt/format.h>
#include <openssl/evp.h>

#include "common/base/uri.h"

namespace pf::gltf {
namespace fs = std::filesystem;
namespace {

std::uint32_t read_u32(std::span<const std::uint8_t> bytes, std::size_t at) {
  std::uint32_t value = 0;
  std::memcpy(&value, bytes.data() + at, sizeof value);  // GLB is little-endian, as x86-64 is
  return value;
}

constexpr std::uint32_t kGlbMagic = 0x46546c67;  // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4e4f534a;
constexpr std::uint32_t kBinChunk = 0x004e4942;

/// JSON and BIN chunks of a GLB [glTF 2.0, 4.4 "Binary glTF Layout"].
Result<std::string_view> split_glb(std::span<const std::uint8_t> bytes, Container& out, Report& report) {
  if (bytes.size() < 12) return report.fail("", "GLB header is cut off; expected 12 bytes");
  const std::uint32_t version = read_u32(bytes, 4);
  const std::uint32_t length = read_u32(bytes, 8);
  if (version != 2) return report.fail("", fmt::format("GLB version {}; expected 2", version));
  if (length > bytes.size()) {
    return report.fail("",
                       fmt::format("GLB header says {} bytes, the file has {}; is it cut off?", length, bytes.size()));
  }
  if (length < 20) return report.fail("", fmt::format("GLB length {}; expected at least a JSON chunk", length));
  if (length < bytes.size()) report.warn("", fmt::format("{} bytes after the end of the GLB", bytes.size() - length));
  bytes = bytes.first(length);
  std::optional<std::string_view> json;
  std::size_t at = 12;
  for (int chunk = 0; at < bytes.size(); ++chunk) {
    if (bytes.size() - at < 8) return report.fail("", fmt::format("header of GLB chunk {} is cut off", chunk));
    const std::size_t size = read_u32(bytes, at);
    const std::uint32_t type = read_u32(bytes, at + 4);
    at += 8;
    if (size > bytes.size() - at) {
      return report.fail("", fmt::format("GLB chunk {} says {} bytes, {} are left", chunk, size, bytes.size() - at));
    }
    if (size % 4 != 0)
      report.warn("", fmt::format("GLB chunk {} has a length of {}; expected a multiple of 4", chunk, size));
    if (chunk == 0 && type != kJsonChunk) return report.fail("", "first GLB chunk is not JSON");
    const auto body = bytes.subspan(at, size);
    if (type == kJsonChunk) {
      if (json) return report.fail("", "second JSON chunk in the GLB; expected one");
      json = std::string_view(reinterpret_cast<const char*>(body.data()), body.size());
    } else if (type == kBinChunk) {
      if (out.bin) return report.fail("", "second BIN chunk in the GLB; expected one");
      if (chunk != 1) report.warn("", "BIN chunk is not the second of the GLB");
      if (size == 0) report.warn("", "BIN chunk of the GLB is empty");
      out.bin = body;
    } else {
      report.warn("", fmt::format("GLB chunk {} of unknown type {:#010x} is ignored", chunk, type));
    }
    at += size;
  }
  return *json;
}

/// Nesting is counted before parsing, outside strings.
bool too_deep(std::string_view json) {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < json.size(); ++i) {
    const char c = json[i];
    if (in_string) {
      if (c == '\\') {
        ++i;
      } else if (c == '"') {
        in_string = false;
      }
    } else if (c == '"') {
      in_string = true;
    } else if (c == '{' || c == '[') {
      if (++depth > kMaxJsonDepth) return true;
    } else if (c == '}' || c == ']') {
      --depth;
    }
  }
  return false;
}

/// Parses, and finds the first key that stands twice in one object (of which nlohmann keeps the last). Throws
/// what nlohmann throws.
Json parse_json(std::string_view text, std::optional<std::string>& twice) {
  std::vector<std::set<std::string>> keys;
  const auto look = [&](int, Json::parse_event_t event, Json& parsed) {
    if (event == Json::parse_event_t::object_start) {
      keys.emplace_back();
    } else if (event == Json::parse_event_t::object_end) {
      keys.pop_back();
    } else if (event == Json::parse_event_t::key && !twice) {
      const auto [it, fresh] = keys.back().insert(parsed.get<std::string>());
      if (!fresh) twice = *it;
    }
    return true;
  };
  return Json::parse(text.begin(), text.end(), look);
}

/// nlohmann's text without its prefix "[json.exception.parse_error.101] ".
std::string parse_message(const Json::exception& e) {
  const std::string_view what = e.what();
  const std::size_t end = what.find("] ");
  std::string message;
  for (const char c : what.substr(end == std::string_view::npos ? 0 : end + 2, 200)) {
    message += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return message;
}

}  // namespace

bool is_inside(const fs::path& path, const fs::path& root) {
  std::error_code error;
  const fs::path real_path = fs::weakly_canonical(path, error);
  if (error) return false;
  const fs::path real_root = fs::canonical(root, error);
  if (error) return false;
  const auto mismatch = std::mismatch(real_root.begin(), real_root.end(), real_path.begin(), real_path.end());
  return mismatch.first == real_root.end();
}

tl::expected<fs::path, std::string> Folder::resolve(std::string_view uri) const {
  if (has_scheme(uri)) {
    return tl::unexpected(fmt::format("URI {} has a scheme; expected a relative path or a data: URI", in_quotes(uri)));
  }
  const std::string name = percent_decoded(uri);
  const bool control =
      std::any_of(name.begin(), name.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; });
  if (name.empty() || control) return tl::unexpected(fmt::format("URI {} is not a file name", in_quotes(uri)));
  if (name.front() == '/' || name.front() == '\\') {
    return tl::unexpected(fmt::format("URI {} is absolute; expected a path relative to the file", in_quotes(uri)));
  }
  if (root_.empty()) return tl::unexpected(fmt::format("URI {} names a file, and no folder is given", in_quotes(uri)));
  const fs::path path = base_ / fs::path(name);
  if (!is_inside(path, root_))
    return tl::unexpected(fmt::format("{} lies outside the scene's folder", in_quotes(name)));
  std::error_code error;
  if (!fs::exists(path, error)) return tl::unexpected(fmt::format("file {} is not found", in_quotes(name)));
  const fs::path real = fs::canonical(path, error);
  if (error || !fs::is_regular_file(real, error)) {
    return tl::unexpected(fmt::format("{} is not a regular file", in_quotes(name)));
  }
  return real;
}

tl::expected<Bytes, std::string> read_file(const fs::path& file, std::uint64_t limit) {
  std::error_code error;
  if (!fs::is_regular_file(file, error))
    return tl::unexpected(fmt::format("{} is not a regular file", in_quotes(file.string())));
  const std::uint64_t size = fs::file_size(file, error);
  std::ifstream stream(file, std::ios::binary);
  if (error || !stream) return tl::unexpected(fmt::format("{} cannot be read", in_quotes(file.string())));
  Bytes bytes(std::min(size, limit));
  stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(stream.gcount()));
  return bytes;
}

bool is_data_uri(std::string_view uri) { return uri.starts_with("data:"); }

tl::expected<DataUri, std::string> decode_data_uri(std::string_view uri) {
  const std::size_t comma = uri.find(',');
  if (comma == std::string_view::npos) return tl::unexpected(std::string("data: URI without a comma"));
  const std::string_view head = uri.substr(5, comma - 5);
  if (!head.ends_with(";base64"))
    return tl::unexpected(std::string("data: URI that is not base64; expected data:<type>;base64,..."));
  DataUri out;
  out.media_type = head.substr(0, head.find(';'));
  std::string_view text = uri.substr(comma + 1);
  std::string unescaped;
  if (text.find('%') != std::string_view::npos) text = unescaped = percent_decoded(text);
  while (!text.empty() && text.back() == '=') text.remove_suffix(1);
  const bool valid = text.size() % 4 != 1 && std::all_of(text.begin(), text.end(), [](char c) {
                       return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '+' || c == '/';
                     });
  if (!valid) return tl::unexpected(std::string("data: URI with characters that are not base64"));
  // EVP_DecodeBlock takes whole groups of four and an int length: whole groups first, in slices, then the
  // padded rest.
  constexpr std::size_t kSlice = std::size_t{1} << 28;
  const std::size_t whole = text.size() / 4 * 4;
  out.bytes.resize(whole / 4 * 3 + 3);
  std::size_t written = 0;
  for (std::size_t at = 0; at < whole; at += kSlice) {
    const int count = static_cast<int>(std::min(kSlice, whole - at));
    const int n =
        EVP_DecodeBlock(out.bytes.data() + written, reinterpret_cast<const unsigned char*>(text.data() + at), count);
    if (n < 0) return tl::unexpected(std::string("data: URI that does not decode as base64"));
    written += static_cast<std::size_t>(n);
  }
  if (whole < text.size()) {
    std::string rest(text.substr(whole));
    const std::size_t bytes = rest.size() - 1;
    rest.resize(4, '=');
    EVP_DecodeBlock(out.bytes.data() + written, reinterpret_cast<const unsigned char*>(rest.data()), 4);
    written += bytes;
  }
  out.bytes.resize(written);
  return out;
}

Result<Container> split(std::span<const std::uint8_t> bytes, Report& report) {
  if (bytes.size() > kMaxFileBytes) return report.fail("", "file is larger than 4 GiB");
  Container out;
  std::string_view json(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (bytes.size() >= 4 && read_u32(bytes, 0) == kGlbMagic) {
    out.binary = true;
    const auto chunk = split_glb(bytes, out, report);
    if (!chunk) return tl::unexpected(chunk.error());
    json = *chunk;
  }
  if (json.starts_with("\xef\xbb\xbf")) {
    report.warn("", "byte order mark before the JSON");
    json.remove_prefix(3);
  }
  if (too_deep(json)) return report.fail("", fmt::format("JSON is nested deeper than {} levels", kMaxJsonDepth));
  try {
    std::optional<std::string> twice;
    out.document = parse_json(json, twice);
    if (twice) return report.fail("", fmt::format("key {} stands twice in one JSON object", in_quotes(*twice)));
  } catch (const Json::exception& e) {
    return report.fail("", fmt::format("not glTF: {}", parse_message(e)));
  }
  if (!out.document.is_object()) return report.fail("", "JSON is not an object; expected a glTF document");
  return out;
}

}  // namespace pf::gltf
