#include <algorithm>
#include <set>
#include <string_view>

#include <fmt/format.h>

#include "worker/scene/gltf_extensions.h"
#include "worker/scene/gltf_material.h"
#include "worker/scene/gltf_validation.h"

namespace pf::gltf {
namespace {

/// Media type of an image from its first bytes, empty when it is none that glTF knows.
std::string_view media_type(std::string_view head) {
  if (head.starts_with("\x89PNG\r\n\x1a\n")) return "image/png";
  if (head.starts_with("\xff\xd8\xff")) return "image/jpeg";
  if (head.starts_with("RIFF") && head.substr(0, 12).ends_with("WEBP")) return "image/webp";
  if (head.starts_with("\xabKTX 20\xbb")) return "image/ktx2";
  return "";
}

Wrap wrap_of(int value) {
  if (value == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return Wrap::kClamp;
  if (value == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT) return Wrap::kMirror;
  return Wrap::kRepeat;
}

std::string name_of(const Json& image, std::size_t index) {
  std::string name = text_or(image, "name", "");
  if (!name.empty()) return name;
  const std::string uri = text_or(image, "uri", "");
  return uri.empty() || is_data_uri(uri) ? fmt::format("image {}", index) : uri;
}

constexpr std::uint64_t kHeadBytes = 16;

}  // namespace

Result<void> TextureTable::check_format(const Image& image, const Json& json, const std::string& pointer) {
  Bytes head;
  if (image.bytes) {
    head.assign(image.bytes->begin(), image.bytes->begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(
                                                                 kHeadBytes, image.bytes->size())));
  } else {
    auto read = read_file(image.file, kHeadBytes);
    if (!read) return report_.fail(pointer, read.error());
    head = std::move(*read);
  }
  const std::string_view type = media_type({reinterpret_cast<const char*>(head.data()), head.size()});
  const std::string said = text_or(json, "mimeType", "");
  if (type == "image/ktx2")
    return report_.fail(pointer, "is a KTX2 image, which is not supported; expected PNG, JPEG or WebP");
  if (type.empty()) return report_.fail(pointer, "is not an image that glTF knows; expected PNG, JPEG or WebP");
  if (!said.empty() && said != type) {
    report_.warn(child(pointer, "mimeType"), fmt::format("says {}, the image is {}", in_quotes(said), type));
  }
  const bool webp = std::find(model_.gltf.extensionsUsed.begin(), model_.gltf.extensionsUsed.end(),
                              "EXT_texture_webp") != model_.gltf.extensionsUsed.end();
  if (type == "image/webp" && !webp) report_.warn(pointer, "is WebP, and the file does not list EXT_texture_webp");
  return {};
}

Result<TextureTable::Image> TextureTable::load_image(const Json& json, const std::string& pointer) {
  Image out;
  if (json.contains("uri")) {
    const auto& uri = json["uri"].get_ref<const std::string&>();
    const std::string at = child(pointer, "uri");
    if (is_data_uri(uri)) {
      auto data = decode_data_uri(uri);
      if (!data) return report_.fail(at, data.error());
      if (!data->media_type.starts_with("image/")) {
        report_.warn(at,
                     fmt::format("has media type {}; expected image/png or image/jpeg", in_quotes(data->media_type)));
      }
      out.bytes = std::make_shared<const Bytes>(std::move(data->bytes));
    } else {
      const auto file = folder_.resolve(uri);
      if (!file) return report_.fail(at, file.error());
      out.file = file->string();
    }
  } else if (json.contains("bufferView")) {
    const auto& view = model_.gltf.bufferViews[unsigned_or(json, "bufferView", 0)];
    const Bytes& data = model_.gltf.buffers[static_cast<std::size_t>(view.buffer)].data;
    if (view.byteOffset + view.byteLength > data.size()) return report_.fail(pointer, "its buffer has no data");
    const auto begin = data.begin() + static_cast<std::ptrdiff_t>(view.byteOffset);
    out.bytes = std::make_shared<const Bytes>(begin, begin + static_cast<std::ptrdiff_t>(view.byteLength));
  } else {
    return report_.fail(pointer, "has neither uri nor bufferView");
  }
  if (auto checked = check_format(out, json, pointer); !checked) return tl::unexpected(checked.error());
  return out;
}

Result<TextureTable::Image> TextureTable::image(std::size_t index) {
  const auto known = images_.find(index);
  if (known != images_.end()) return known->second;
  auto loaded = load_image(model_.images[index], child("/images", index));
  if (loaded) images_.emplace(index, *loaded);
  return loaded;
}

Result<int> TextureTable::source_of(const tinygltf::Texture& texture, const std::string& pointer) {
  if (const tinygltf::Value* webp = find(texture.extensions, "EXT_texture_webp");
      webp != nullptr && webp->Has("source")) {
    return webp->Get("source").GetNumberAsInt();
  }
  const tinygltf::Value* basis = find(texture.extensions, "KHR_texture_basisu");
  if (texture.source >= static_cast<int>(model_.images.size())) {
    return report_.fail(child(pointer, "source"),
                        fmt::format("is {}; expected an index into images, which has {} elements", texture.source,
                                    model_.images.size()));
  }
  if (texture.source >= 0) return texture.source;
  if (basis != nullptr) {
    return report_.fail(pointer,
                        "has only a KHR_texture_basisu image, which is not supported; expected a source as well");
  }
  report_.warn(pointer, "has no source; what uses it stays untextured");
  return -1;
}

Result<int> TextureTable::add(int index, ColorSpace color_space) {
  const auto known = known_.find({index, color_space});
  if (known != known_.end()) return known->second;
  const tinygltf::Texture& texture = model_.gltf.textures[static_cast<std::size_t>(index)];
  auto source = source_of(texture, child("/textures", static_cast<std::size_t>(index)));
  if (!source) return source;
  int out = -1;
  if (*source >= 0) {
    auto loaded = image(static_cast<std::size_t>(*source));
    if (!loaded) return tl::unexpected(loaded.error());
    Texture t;
    t.name = name_of(model_.images[static_cast<std::size_t>(*source)], static_cast<std::size_t>(*source));
    t.file = loaded->file;
    t.bytes = loaded->bytes;
    t.color_space = color_space;
    if (texture.sampler >= 0) {
      const tinygltf::Sampler& sampler = model_.gltf.samplers[static_cast<std::size_t>(texture.sampler)];
      t.wrap_s = wrap_of(sampler.wrapS);
      t.wrap_t = wrap_of(sampler.wrapT);
      t.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
    }
    out = static_cast<int>(textures_.size());
    textures_.push_back(std::move(t));
  }
  known_[{index, color_space}] = out;
  return out;
}

void TextureTable::check_unused() {
  for (std::size_t i = 0; i < model_.images.size(); ++i) {
    if (images_.contains(i)) continue;
    const auto loaded = load_image(model_.images[i], child("/images", i));
    if (!loaded) report_.warn(loaded.error(), "nothing in the scene uses it");
  }
}

}  // namespace pf::gltf
