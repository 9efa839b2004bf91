#include "worker/scene/gltf_material.h"

#include <algorithm>

#include <fmt/format.h>

namespace pf::gltf {
namespace {

Rgb rgb(const std::vector<double>& v, const Rgb& absent) {
  if (v.size() < 3) return absent;
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

Rgb rgb_or(const tinygltf::Value& object, const std::string& name, const Rgb& absent) {
  const tinygltf::Value* v = find(object, name);
  if (v == nullptr || v->ArrayLen() < 3) return absent;
  return {static_cast<float>(v->Get(0).GetNumberAsDouble()), static_cast<float>(v->Get(1).GetNumberAsDouble()),
          static_cast<float>(v->Get(2).GetNumberAsDouble())};
}

Vec2f vec2_or(const tinygltf::Value& object, const std::string& name, const Vec2f& absent) {
  const tinygltf::Value* v = find(object, name);
  if (v == nullptr || v->ArrayLen() < 2) return absent;
  return {static_cast<float>(v->Get(0).GetNumberAsDouble()), static_cast<float>(v->Get(1).GetNumberAsDouble())};
}

/// Reads one material; the first error stays in `error` and later slots are skipped.
class MaterialReader {
 public:
  explicit MaterialReader(TextureTable& textures) : textures_(textures) {}

  void core(const tinygltf::Material& in, Material& out);
  void extensions(const tinygltf::ExtensionMap& in, Material& out);
  [[nodiscard]] const Result<void>& status() const { return status_; }

 private:
  TextureRef texture(int index, int uv_set, const tinygltf::Value* transform, ColorSpace color_space);
  template <typename Info>
  TextureRef texture(const Info& info, ColorSpace color_space) {
    return texture(info.index, info.texCoord, find(info.extensions, "KHR_texture_transform"), color_space);
  }
  TextureRef texture(const tinygltf::Value& owner, const std::string& name, ColorSpace color_space);
  void volume(const tinygltf::Value& v, Material& out);

  TextureTable& textures_;
  Result<void> status_;
};

TextureRef MaterialReader::texture(int index, int uv_set, const tinygltf::Value* transform, ColorSpace color_space) {
  TextureRef out;
  if (index < 0 || !status_) return out;
  const auto added = textures_.add(index, color_space);
  if (!added) {
    status_ = tl::unexpected(added.error());
    return out;
  }
  out.texture = *added;
  out.uv_set = uv_set;
  if (transform == nullptr) return out;
  out.offset = vec2_or(*transform, "offset", out.offset);
  out.scale = vec2_or(*transform, "scale", out.scale);
  out.rotation = number_or(*transform, "rotation", 0.0f);
  out.uv_set = int_or(*transform, "texCoord", uv_set);
  return out;
}

TextureRef MaterialReader::texture(const tinygltf::Value& owner, const std::string& name, ColorSpace color_space) {
  const tinygltf::Value* info = find(owner, name);
  if (info == nullptr) return {};
  const tinygltf::Value* nested = find(*info, "extensions");
  const tinygltf::Value* transform = nested == nullptr ? nullptr : find(*nested, "KHR_texture_transform");
  return texture(int_or(*info, "index", -1), int_or(*info, "texCoord", 0), transform, color_space);
}

void MaterialReader::core(const tinygltf::Material& in, Material& out) {
  const tinygltf::PbrMetallicRoughness& pbr = in.pbrMetallicRoughness;
  out.base_color = rgb(pbr.baseColorFactor, out.base_color);
  if (pbr.baseColorFactor.size() == 4) out.alpha = static_cast<float>(pbr.baseColorFactor[3]);
  out.base_color_texture = texture(pbr.baseColorTexture, ColorSpace::kSrgb);
  out.metallic = static_cast<float>(pbr.metallicFactor);
  out.roughness = static_cast<float>(pbr.roughnessFactor);
  out.metallic_roughness_texture = texture(pbr.metallicRoughnessTexture, ColorSpace::kLinear);
  out.normal_texture = texture(in.normalTexture, ColorSpace::kLinear);
  out.normal_scale = static_cast<float>(in.normalTexture.scale);
  out.emission = rgb(in.emissiveFactor, out.emission);
  out.emission_texture = texture(in.emissiveTexture, ColorSpace::kSrgb);
  if (in.alphaMode == "MASK") out.alpha_mode = AlphaMode::kMask;
  if (in.alphaMode == "BLEND") out.alpha_mode = AlphaMode::kBlend;
  out.alpha_cutoff = static_cast<float>(in.alphaCutoff);
  out.double_sided = in.doubleSided;
}

void MaterialReader::volume(const tinygltf::Value& v, Material& out) {
  // The mesh itself bounds the medium; thickness only says whether there is one, its texture nothing.
  out.thickness = number_or(v, "thicknessFactor", 0.0f);
  out.attenuation_distance = number_or(v, "attenuationDistance", kInfinity);
  out.attenuation_color = rgb_or(v, "attenuationColor", out.attenuation_color);
}

void MaterialReader::extensions(const tinygltf::ExtensionMap& in, Material& out) {
  out.unlit = in.contains("KHR_materials_unlit");
  if (const auto* v = find(in, "KHR_materials_emissive_strength"))
    out.emission *= number_or(*v, "emissiveStrength", 1.0f);
  if (const auto* v = find(in, "KHR_materials_ior")) out.ior = number_or(*v, "ior", 1.5f);
  if (const auto* v = find(in, "KHR_materials_specular")) {
    out.specular = number_or(*v, "specularFactor", 1.0f);
    out.specular_texture = texture(*v, "specularTexture", ColorSpace::kLinear);
    out.specular_color = rgb_or(*v, "specularColorFactor", out.specular_color);
    out.specular_color_texture = texture(*v, "specularColorTexture", ColorSpace::kSrgb);
  }
  if (const auto* v = find(in, "KHR_materials_transmission")) {
    out.transmission = number_or(*v, "transmissionFactor", 0.0f);
    out.transmission_texture = texture(*v, "transmissionTexture", ColorSpace::kLinear);
  }
  if (const auto* v = find(in, "KHR_materials_volume")) volume(*v, out);
  if (const auto* v = find(in, "KHR_materials_clearcoat")) {
    out.clearcoat = number_or(*v, "clearcoatFactor", 0.0f);
    out.clearcoat_texture = texture(*v, "clearcoatTexture", ColorSpace::kLinear);
    out.clearcoat_roughness = number_or(*v, "clearcoatRoughnessFactor", 0.0f);
    out.clearcoat_roughness_texture = texture(*v, "clearcoatRoughnessTexture", ColorSpace::kLinear);
    out.clearcoat_normal_texture = texture(*v, "clearcoatNormalTexture", ColorSpace::kLinear);
    const tinygltf::Value* normal = find(*v, "clearcoatNormalTexture");
    if (normal != nullptr) out.clearcoat_normal_scale = number_or(*normal, "scale", 1.0f);
  }
  if (const auto* v = find(in, "KHR_materials_sheen")) {
    out.sheen_color = rgb_or(*v, "sheenColorFactor", out.sheen_color);
    out.sheen_color_texture = texture(*v, "sheenColorTexture", ColorSpace::kSrgb);
    out.sheen_roughness = number_or(*v, "sheenRoughnessFactor", 0.0f);
    out.sheen_roughness_texture = texture(*v, "sheenRoughnessTexture", ColorSpace::kLinear);
  }
}

}  // namespace

Result<Material> read_material(const Model& model, std::size_t index, TextureTable& textures, Report& report) {
  const tinygltf::Material& in = model.gltf.materials[index];
  MaterialReader reader(textures);
  Material out;
  out.name = in.name.empty() ? fmt::format("material {}", index) : in.name;
  reader.core(in, out);
  reader.extensions(in.extensions, out);
  if (!reader.status()) return tl::unexpected(reader.status().error());
  if (!is_finite(out.emission)) {
    return report.fail(child("/materials", index),
                       "emissiveFactor times emissiveStrength is not a single-precision number");
  }
  return out;
}

std::vector<TextureRef*> texture_refs(Material& m) {
  return {&m.base_color_texture,       &m.metallic_roughness_texture, &m.normal_texture,
          &m.emission_texture,         &m.specular_texture,           &m.specular_color_texture,
          &m.transmission_texture,     &m.clearcoat_texture,          &m.clearcoat_roughness_texture,
          &m.clearcoat_normal_texture, &m.sheen_color_texture,        &m.sheen_roughness_texture};
}

}  // namespace pf::gltf
