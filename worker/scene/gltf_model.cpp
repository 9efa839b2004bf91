#include "worker/scene/gltf_model.h"

#include <algorithm>
#include <array>
#include <exception>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include "worker/scene/gltf_validation.h"

namespace pf::gltf {
namespace {

/// Buffers may name the same file again and again.
constexpr std::uint64_t kMaxBufferBytes = 2 * kMaxFileBytes;

Result<Bytes> load_buffer(const Json& buffer, const std::string& pointer, const Folder& folder, Report& report) {
  const std::string& uri = buffer["uri"].get_ref<const std::string&>();
  const std::string at = child(pointer, "uri");
  const std::uint64_t length = unsigned_or(buffer, "byteLength", 0);
  Bytes bytes;
  if (is_data_uri(uri)) {
    auto data = decode_data_uri(uri);
    if (!data) return report.fail(at, data.error());
    if (data->media_type != "application/octet-stream" && data->media_type != "application/gltf-buffer") {
      report.warn(at, fmt::format("has media type {}; expected application/octet-stream", in_quotes(data->media_type)));
    }
    bytes = std::move(data->bytes);
  } else {
    const auto file = folder.resolve(uri);
    if (!file) return report.fail(at, file.error());
    // One byte more shows that the file is longer than it should be.
    auto data = read_file(*file, length + 1);
    if (!data) return report.fail(at, data.error());
    bytes = std::move(*data);
  }
  if (bytes.size() < length)
    return report.fail(pointer, fmt::format("has {} bytes; byteLength says {}", bytes.size(), length));
  if (bytes.size() > length) report.warn(pointer, fmt::format("has more bytes than byteLength {} says", length));
  bytes.resize(length);
  return bytes;
}

Result<std::vector<Bytes>> load_buffers(const Container& container, const Folder& folder, Report& report) {
  const Json& buffers = elements(container.document, "buffers");
  std::vector<Bytes> out(buffers.size());
  std::uint64_t total = 0;
  if (container.bin && (buffers.empty() || buffers[0].contains("uri"))) {
    report.warn("/buffers", "no buffer uses the GLB's BIN chunk");
  }
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    const std::string pointer = child("/buffers", i);
    const std::uint64_t length = unsigned_or(buffers[i], "byteLength", 0);
    total += length;
    if (total > kMaxBufferBytes) return report.fail(pointer, "buffers are larger than 8 GiB together");
    if (buffers[i].contains("uri")) {
      auto bytes = load_buffer(buffers[i], pointer, folder, report);
      if (!bytes) return tl::unexpected(bytes.error());
      out[i] = std::move(*bytes);
    } else if (i == 0 && container.bin) {
      const std::uint64_t size = container.bin->size();
      if (size < length)
        return report.fail(pointer, fmt::format("byteLength is {}; the BIN chunk has {} bytes", length, size));
      // The chunk is padded to a multiple of four.
      if (size > length + 3)
        report.warn(pointer, fmt::format("byteLength is {}; the BIN chunk has {} bytes", length, size));
      out[i].assign(container.bin->begin(), container.bin->begin() + static_cast<std::ptrdiff_t>(length));
    } else {
      // Legal for placeholders; whoever reads from it gets an error.
      report.warn(pointer, container.binary && i == 0 ? "has neither a uri nor a BIN chunk: it has no data"
                                                      : "has no uri: it has no data");
    }
  }
  return out;
}

/// tinygltf refuses indices without a buffer view, which compressed meshes have, so they are taken out and
/// put back.
using Indices = std::vector<std::vector<int>>;

Indices take_indices(Json& document) {
  Indices out;
  if (!document.contains("meshes")) return out;
  for (Json& mesh : document["meshes"]) {
    auto& of_mesh = out.emplace_back();
    for (Json& primitive : mesh["primitives"]) {
      of_mesh.push_back(primitive.contains("indices") ? primitive["indices"].get<int>() : -1);
      primitive.erase("indices");
    }
  }
  return out;
}

bool no_file_exists(const std::string&, void*) { return false; }
std::string unexpanded(const std::string& path, void*) { return path; }
bool read_nothing(std::vector<unsigned char>*, std::string*, const std::string&, void*) { return false; }
bool write_nothing(std::string*, const std::string&, const std::vector<unsigned char>&, void*) { return false; }

Result<tinygltf::Model> parse(const Json& document, Report& report) {
  tinygltf::Model model;
  std::string error;
  std::string warning;
  try {
    tinygltf::TinyGLTF loader;
    loader.SetFsCallbacks({&no_file_exists, &unexpanded, &read_nothing, &write_nothing, nullptr});
    const std::string text = document.dump();
    if (text.size() > std::numeric_limits<unsigned>::max()) return report.fail("", "JSON is larger than 4 GiB");
    if (!loader.LoadASCIIFromString(&model, &error, &warning, text.data(), static_cast<unsigned>(text.size()), "")) {
      std::replace_if(
          error.begin(), error.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
      return report.fail("", fmt::format("not valid glTF: {}", error));
    }
  } catch (const std::exception& e) {
    return report.fail("", fmt::format("not valid glTF: {}", e.what()));
  }
  return model;
}

}  // namespace

const tinygltf::Value* find(const tinygltf::ExtensionMap& extensions, const std::string& name) {
  const auto it = extensions.find(name);
  return it == extensions.end() || !it->second.IsObject() ? nullptr : &it->second;
}

const tinygltf::Value* find(const tinygltf::Value& object, const std::string& name) {
  return object.Has(name) ? &object.Get(name) : nullptr;
}

int int_or(const tinygltf::Value& object, const std::string& name, int absent) {
  const tinygltf::Value* value = find(object, name);
  return value != nullptr && value->IsNumber() ? value->GetNumberAsInt() : absent;
}

float number_or(const tinygltf::Value& object, const std::string& name, float absent) {
  const tinygltf::Value* value = find(object, name);
  return value != nullptr && value->IsNumber() ? static_cast<float>(value->GetNumberAsDouble()) : absent;
}

Result<Model> make_model(Container container, std::uint64_t document_bytes, const Folder& folder, Report& report) {
  auto buffers = load_buffers(container, folder, report);
  if (!buffers) return tl::unexpected(buffers.error());
  Model out;
  Json& document = container.document;
  out.images = elements(document, "images");
  out.animations = elements(document, "animations");
  for (const char* list : {"images", "animations", "buffers"}) document.erase(list);
  const Indices indices = take_indices(document);
  auto parsed = parse(document, report);
  if (!parsed) return tl::unexpected(parsed.error());
  out.gltf = std::move(*parsed);
  for (std::size_t m = 0; m < indices.size(); ++m) {
    for (std::size_t p = 0; p < indices[m].size(); ++p) out.gltf.meshes.at(m).primitives.at(p).indices = indices[m][p];
  }
  out.bytes = document_bytes;
  for (Bytes& bytes : *buffers) {
    out.bytes += bytes.size();
    out.gltf.buffers.emplace_back().data = std::move(bytes);
  }
  return out;
}

}  // namespace pf::gltf
