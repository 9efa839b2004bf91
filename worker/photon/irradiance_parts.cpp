#include "worker/photon/irradiance_parts.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>

namespace pf {
namespace {

/// Bytes that say all of a part.
class Content {
 public:
  template <typename T>
  void add(const T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    const auto* bytes = reinterpret_cast<const char*>(&value);
    bytes_.append(bytes, sizeof(T));
  }
  void add(const Vec3f& v) { add(v.x), add(v.y), add(v.z); }
  void add(const std::string& text) {
    add(text.size());
    bytes_ += text;
  }
  template <typename T>
  void add(const std::vector<T>& values) {
    static_assert(std::is_standard_layout_v<T>);
    add(values.size());
    bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  void add(const Matrix44f& m) {
    for (int i = 0; i < 16; ++i) add(m.getValue()[i]);
  }
  [[nodiscard]] Hash128 hash() const { return xxh3_128(std::string_view(bytes_)); }

 private:
  std::string bytes_;
};

Result<std::vector<std::string>> hash_textures(const SceneDescription& scene) {
  std::vector<std::string> all;
  for (const Texture& texture : scene.textures) {
    Content content;
    if (!texture.file.empty()) {
      auto digest = sha256_hex_of_file(texture.file);
      if (!digest) return tl::unexpected(digest.error());
      content.add(*digest);
    } else if (texture.bytes) {
      content.add(*texture.bytes);
    }
    content.add(texture.wrap_s), content.add(texture.wrap_t), content.add(texture.nearest),
        content.add(texture.color_space);
    all.push_back(content.hash().hex());
  }
  return all;
}

void add_texture(Content& content, const TextureRef& ref, const std::vector<std::string>& textures) {
  content.add(ref.present());
  if (!ref.present()) return;
  content.add(textures[static_cast<std::size_t>(ref.texture)]);
  content.add(ref.uv_set), content.add(ref.offset.x), content.add(ref.offset.y), content.add(ref.scale.x);
  content.add(ref.scale.y), content.add(ref.rotation);
}

/// Every field of a material but its name.
void add_material(Content& content, const Material& m, const std::vector<std::string>& textures) {
  for (const Rgb& color : {m.base_color, m.emission, m.specular_color, m.attenuation_color, m.sheen_color})
    content.add(color);
  for (const float value : {m.alpha, m.metallic, m.roughness, m.normal_scale, m.alpha_cutoff, m.ior, m.specular,
                            m.transmission, m.thickness, m.attenuation_distance, m.clearcoat, m.clearcoat_roughness,
                            m.clearcoat_normal_scale, m.sheen_roughness}) {
    content.add(value);
  }
  content.add(m.alpha_mode), content.add(m.double_sided), content.add(m.unlit);
  for (const TextureRef* ref : {&m.base_color_texture, &m.metallic_roughness_texture, &m.normal_texture,
                                &m.emission_texture, &m.specular_texture, &m.specular_color_texture,
                                &m.transmission_texture, &m.clearcoat_texture, &m.clearcoat_roughness_texture,
                                &m.clearcoat_normal_texture, &m.sheen_color_texture, &m.sheen_roughness_texture}) {
    add_texture(content, *ref, textures);
  }
}

Vec3f transform(const Vec3f& p, const Matrix44f& m) { return p * m; }

ScenePart part_of(const SceneDescription& scene, const MeshInstance& instance,
                  const std::vector<std::string>& textures) {
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
  const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
  Content content;
  content.add(instance.object_to_world);
  content.add(mesh.positions), content.add(mesh.normals), content.add(mesh.tangents), content.add(mesh.colors);
  for (const auto& set : mesh.uv) content.add(set);
  content.add(mesh.triangles);
  add_material(content, material, textures);
  ScenePart part;
  part.hash = content.hash();
  float area = 0.0f;
  for (const auto& triangle : mesh.triangles) {
    Vec3f corners[3];
    for (int i = 0; i < 3; ++i) {
      corners[i] = transform(mesh.positions[triangle[static_cast<std::size_t>(i)]], instance.object_to_world);
      part.bounds.extendBy(corners[i]);
    }
    area += 0.5f * length(cross(corners[1] - corners[0], corners[2] - corners[0]));
  }
  const Rgb radiance = material.unlit ? material.emission + material.base_color : material.emission;
  part.flux = radiance * (area * kPi * (material.double_sided ? 2.0f : 1.0f));
  return part;
}

ScenePart part_of(const PunctualLight& light) {
  Content content;
  content.add(light.kind), content.add(light.intensity), content.add(light.position), content.add(light.direction);
  content.add(light.cos_inner), content.add(light.cos_outer);
  ScenePart part;
  part.hash = content.hash();
  if (light.kind != PunctualKind::kDirectional) part.bounds.extendBy(light.position);
  if (light.kind == PunctualKind::kSpot) {
    part.axis = light.direction;
    part.cosine = light.cos_outer;
  }
  part.flux = light.intensity * (2.0f * kPi * (1.0f - part.cosine));
  return part;
}

}  // namespace

Result<std::vector<ScenePart>> scene_parts(const SceneDescription& scene) {
  auto textures = hash_textures(scene);
  if (!textures) return tl::unexpected(textures.error());
  std::vector<ScenePart> parts;
  for (const MeshInstance& instance : scene.instances) {
    ScenePart part = part_of(scene, instance, *textures);
    if (!part.bounds.isEmpty()) parts.push_back(part);
  }
  for (const PunctualLight& light : scene.lights) parts.push_back(part_of(light));
  Content content;
  if (!scene.environment.file.empty()) {
    auto digest = sha256_hex_of_file(scene.environment.file);
    if (!digest) return tl::unexpected(digest.error());
    content.add(*digest);
  }
  content.add(scene.environment.radiance);
  ScenePart environment;
  environment.hash = content.hash();
  parts.push_back(environment);
  return parts;
}

bool SceneChange::holds(const Vec3f& point) const {
  return std::any_of(boxes.begin(), boxes.end(), [&](const Box3f& box) { return box.intersects(point); });
}

bool SceneChange::crossed(const Vec3f& origin, const Vec3f& direction, float length, float* enter) const {
  float first = kInfinity;
  for (const Box3f& box : boxes) {
    float from = 0.0f, to = length;
    for (int axis = 0; axis < 3; ++axis) {
      if (direction[axis] == 0.0f) {
        if (origin[axis] < box.min[axis] || origin[axis] > box.max[axis]) to = -1.0f;
        continue;
      }
      const float a = (box.min[axis] - origin[axis]) / direction[axis],
                  b = (box.max[axis] - origin[axis]) / direction[axis];
      from = std::max(from, std::min(a, b));
      to = std::min(to, std::max(a, b));
    }
    if (from <= to) first = std::min(first, from);
  }
  if (enter != nullptr) *enter = first;
  return first < kInfinity;
}

SceneChange change_between(const std::vector<ScenePart>& before, const std::vector<ScenePart>& after) {
  Box3f all;
  for (const auto* parts : {&before, &after}) {
    for (const ScenePart& part : *parts) all.extendBy(part.bounds);
  }
  constexpr float kMargin = 1e-4f;  // of the scene's size
  const float margin = all.isEmpty() ? 0.0f : kMargin * length(all.size());
  SceneChange change;
  std::vector<bool> matched(before.size());
  const auto note = [&](const ScenePart& part) {
    if (part.everywhere()) {
      change.everywhere = true;
    } else {
      const Vec3f around{margin, margin, margin};
      change.boxes.emplace_back(part.bounds.min - around, part.bounds.max + around);
    }
  };
  for (const ScenePart& part : after) {
    bool found = false;
    for (std::size_t i = 0; i < before.size() && !found; ++i) {
      if (matched[i] || !(before[i].hash == part.hash)) continue;
      matched[i] = found = true;
    }
    if (!found) note(part);
  }
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (matched[i]) continue;
    note(before[i]);
    if (!before[i].everywhere() && !is_zero(before[i].flux)) change.gone_lights.push_back(before[i]);
  }
  return change;
}

}  // namespace pf
