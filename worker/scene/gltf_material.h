#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "worker/scene/gltf_model.h"
#include "worker/scene/scene_description.h"

namespace pf::gltf {

/// Textures as materials ask for them: the same glTF texture read in two colour spaces becomes two.
class TextureTable {
 public:
  TextureTable(const Model& model, const Folder& folder, Report& report)
      : model_(model), folder_(folder), report_(report) {}

  /// Index into textures() of glTF texture `index`; -1 where it has no image.
  [[nodiscard]] Result<int> add(int index, ColorSpace color_space);
  /// A warning for each image that no material uses and that could not be read.
  void check_unused();
  [[nodiscard]] std::vector<Texture> take() { return std::move(textures_); }

 private:
  struct Image {
    std::string file;
    std::shared_ptr<const Bytes> bytes;  // shared: several textures may show one image
  };
  [[nodiscard]] Result<Image> image(std::size_t index);
  [[nodiscard]] Result<Image> load_image(const Json& image, const std::string& pointer);
  [[nodiscard]] Result<int> source_of(const tinygltf::Texture& texture, const std::string& pointer);
  [[nodiscard]] Result<void> check_format(const Image& image, const Json& json, const std::string& pointer);

  const Model& model_;
  const Folder& folder_;
  Report& report_;
  std::map<std::size_t, Image> images_;
  std::map<std::pair<int, ColorSpace>, int> known_;
  std::vector<Texture> textures_;
};

/// Every texture slot of a material.
[[nodiscard]] std::vector<TextureRef*> texture_refs(Material& material);

/// glTF material `index` with its KHR_materials_* extensions.
[[nodiscard]] Result<Material> read_material(const Model& model, std::size_t index, TextureTable& textures,
                                             Report& report);

}  // namespace pf::gltf
