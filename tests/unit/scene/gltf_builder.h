#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "worker/scene/gltf_loader.h"

namespace pf {

/// Puts tiny glTF files together: bytes go into one buffer, written as the BIN chunk of a GLB.
class GltfBuilder {
 public:
  nlohmann::json json = {{"asset", {{"version", "2.0"}}}, {"scene", 0}, {"scenes", {{{"nodes", {0}}}}}};

  /// Appends values as one buffer view (aligned to 4); returns its index.
  template <typename T>
  int view(const std::vector<T>& values, int byte_stride = 0) {
    while (bytes_.size() % 4 != 0) bytes_.push_back(0);
    nlohmann::json v = {{"buffer", 0}, {"byteOffset", bytes_.size()}, {"byteLength", values.size() * sizeof(T)}};
    if (byte_stride > 0) v["byteStride"] = byte_stride;
    const auto* begin = reinterpret_cast<const std::uint8_t*>(values.data());
    bytes_.insert(bytes_.end(), begin, begin + values.size() * sizeof(T));
    json["bufferViews"].push_back(v);
    return static_cast<int>(json["bufferViews"].size()) - 1;
  }
  /// Appends an accessor; `view` < 0: none.
  int accessor(int view, int component_type, const std::string& type, std::size_t count,
               nlohmann::json more = nlohmann::json::object()) {
    nlohmann::json a = {{"componentType", component_type}, {"type", type}, {"count", count}};
    if (view >= 0) a["bufferView"] = view;
    a.update(more);
    json["accessors"].push_back(a);
    return static_cast<int>(json["accessors"].size()) - 1;
  }
  /// Floats as an accessor.
  int floats(const std::vector<float>& values, const std::string& type, int components) {
    return accessor(view(values), 5126, type, values.size() / static_cast<std::size_t>(components));
  }
  /// A mesh of one primitive, and a node that shows it.
  nlohmann::json& primitive(nlohmann::json attributes) {
    json["meshes"] = {{{"primitives", {{{"attributes", std::move(attributes)}}}}}};
    json["nodes"] = {{{"mesh", 0}}};
    return json["meshes"][0]["primitives"][0];
  }
  void use(const std::string& extension) { json["extensionsUsed"].push_back(extension); }

  [[nodiscard]] std::vector<std::uint8_t> glb() const {
    nlohmann::json document = json;
    std::vector<std::uint8_t> bin = bytes_;
    if (!bin.empty()) document["buffers"] = {{{"byteLength", bin.size()}}};
    while (bin.size() % 4 != 0) bin.push_back(0);
    std::string text = document.dump();
    while (text.size() % 4 != 0) text += ' ';
    std::vector<std::uint8_t> out;
    const auto word = [&](std::size_t value) {
      for (int i = 0; i < 4; ++i) out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
    };
    word(0x46546c67);
    word(2);
    word(12 + 8 + text.size() + (bin.empty() ? 0 : 8 + bin.size()));
    word(text.size());
    word(0x4e4f534a);
    out.insert(out.end(), text.begin(), text.end());
    if (!bin.empty()) {
      word(bin.size());
      word(0x004e4942);
      out.insert(out.end(), bin.begin(), bin.end());
    }
    return out;
  }
  [[nodiscard]] Result<SceneDescription> load() const { return load_gltf_from_memory(glb(), {}); }

 private:
  std::vector<std::uint8_t> bytes_;
};

/// Corners of the triangle (0,0,0), (1,0,0), (0,1,0).
inline const std::vector<float> kTriangle = {0, 0, 0, 1, 0, 0, 0, 1, 0};

}  // namespace pf
