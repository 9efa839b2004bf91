#include "jobs/scenes/generate/gltf.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace pf::scenes {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kFloat = 5126, kUnsignedShort = 5123, kUnsignedInt = 5125;  // glTF 2.0, 5.1.3
constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;          // glTF 2.0, 5.11.5

static_assert(std::endian::native == std::endian::little, "glTF is little-endian and numbers are copied as they are");

template <typename T>
void append(std::string& bytes, T value) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof(T));
  bytes.append(raw.data(), raw.size());
}

Json array(const Vec3& v) { return Json::array({v.x, v.y, v.z}); }

/// Columns x, y, z, position of a rigid placement whose local -z points along `forward`.
Json placement(const Vec3& position, const Vec3& forward) {
  const Vec3 z = -forward.normalized();
  const Vec3 up = std::abs(z.y) > 0.999999 ? Vec3(0, 0, -1) : Vec3(0, 1, 0);
  const Vec3 x = up.cross(z).normalized();
  const Vec3 y = z.cross(x);
  Json m = Json::array();
  for (const Vec3& column : {x, y, z, position}) {
    for (int i = 0; i < 3; ++i) m.push_back(column[i] + 0.0);  // no -0.0 in the text
    m.push_back(0.0);
  }
  m.back() = 1.0;
  return m;
}

Material surface(const std::string& name, const Vec3& color, double metallic, double roughness) {
  return {{"name", name},
          {"pbrMetallicRoughness",
           {{"baseColorFactor", Json::array({color.x, color.y, color.z, 1.0})},
            {"metallicFactor", metallic},
            {"roughnessFactor", roughness}}}};
}

}  // namespace

Material lambert(const std::string& name, const Vec3& albedo) {
  Material m = surface(name, albedo, 0.0, 1.0);
  m["extensions"]["KHR_materials_specular"]["specularFactor"] = 0.0;
  return m;
}

Material emitter(const std::string& name, const Vec3& radiance, const Vec3& albedo) {
  Material m = lambert(name, albedo);
  const double strength = std::max({radiance.x, radiance.y, radiance.z, 1.0});
  m["emissiveFactor"] = array(radiance / strength);
  m["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] = strength;
  return m;
}

Material metal(const std::string& name, const Vec3& color, double roughness) {
  return surface(name, color, 1.0, roughness);
}

Material dielectric(const std::string& name, double ior, double thickness) {
  Material m = surface(name, Vec3(1.0), 0.0, 0.0);
  m["extensions"]["KHR_materials_transmission"]["transmissionFactor"] = 1.0;
  m["extensions"]["KHR_materials_ior"]["ior"] = ior;
  m["extensions"]["KHR_materials_volume"]["thicknessFactor"] = thickness;
  return m;
}

Material dielectric(const std::string& name, double ior, double thickness, const Vec3& color, double distance) {
  Material m = dielectric(name, ior, thickness);
  m["extensions"]["KHR_materials_volume"]["attenuationDistance"] = distance;
  m["extensions"]["KHR_materials_volume"]["attenuationColor"] = array(color);
  return m;
}

int GltfBuilder::add_material(const Material& material) {
  const auto known = std::find(materials_.begin(), materials_.end(), material);
  if (known != materials_.end()) return static_cast<int>(known - materials_.begin());
  if (material.contains("extensions")) {
    for (const auto& item : material["extensions"].items()) extensions_.insert(item.key());
  }
  materials_.push_back(material);
  return static_cast<int>(materials_.size()) - 1;
}

int GltfBuilder::add_view(std::size_t offset, int target) {
  views_.push_back(
      {{"buffer", 0}, {"byteOffset", offset}, {"byteLength", binary_.size() - offset}, {"target", target}});
  binary_.resize((binary_.size() + 3) / 4 * 4, '\0');
  return static_cast<int>(views_.size()) - 1;
}

int GltfBuilder::add_floats(const std::vector<Vec3>& values, bool with_bounds) {
  const std::size_t offset = binary_.size();
  std::array<float, 3> low, high;
  low.fill(std::numeric_limits<float>::max());
  high.fill(std::numeric_limits<float>::lowest());
  for (const Vec3& v : values) {
    for (std::size_t i = 0; i < 3; ++i) {
      const float x = static_cast<float>(v[static_cast<int>(i)]) + 0.0f;
      low[i] = std::min(low[i], x);
      high[i] = std::max(high[i], x);
      append(binary_, x);
    }
  }
  const int view = add_view(offset, kArrayBuffer);
  Json accessor = {{"bufferView", view}, {"componentType", kFloat}, {"count", values.size()}, {"type", "VEC3"}};
  if (with_bounds) {
    accessor["min"] = low;
    accessor["max"] = high;
  }
  accessors_.push_back(std::move(accessor));
  return static_cast<int>(accessors_.size()) - 1;
}

int GltfBuilder::add_indices(const Mesh& mesh) {
  const bool is_short = mesh.positions.size() <= 65535;  // 65535 itself means "restart" and is no index
  const std::size_t offset = binary_.size();
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t i : triangle) {
      if (is_short)
        append(binary_, static_cast<std::uint16_t>(i));
      else
        append(binary_, i);
    }
  }
  const int view = add_view(offset, kElementArrayBuffer);
  accessors_.push_back({{"bufferView", view},
                        {"componentType", is_short ? kUnsignedShort : kUnsignedInt},
                        {"count", mesh.triangles.size() * 3},
                        {"type", "SCALAR"}});
  return static_cast<int>(accessors_.size()) - 1;
}

Json GltfBuilder::add_attributes(const Mesh& mesh, bool normals_are_positions) {
  Json primitive;
  const int positions = add_floats(mesh.positions, true);
  primitive["attributes"]["POSITION"] = positions;
  if (normals_are_positions) {
    primitive["attributes"]["NORMAL"] = positions;
  } else if (!mesh.normals.empty()) {
    primitive["attributes"]["NORMAL"] = add_floats(mesh.normals, false);
  }
  if (!mesh.colors.empty()) primitive["attributes"]["COLOR_0"] = add_floats(mesh.colors, false);
  primitive["indices"] = add_indices(mesh);
  return primitive;
}

void GltfBuilder::add_node(Json node) { nodes_.push_back(std::move(node)); }

void GltfBuilder::add(const std::string& name, const Mesh& mesh, const Material& material) {
  Json primitive = add_attributes(mesh, false);
  primitive["material"] = add_material(material);
  meshes_.push_back({{"name", name}, {"primitives", Json::array({primitive})}});
  add_node({{"name", name}, {"mesh", meshes_.size() - 1}});
}

void GltfBuilder::add_sphere(const std::string& name, const Vec3& centre, double radius, int subdivisions,
                             const Material& material) {
  auto shared = spheres_.find(subdivisions);
  if (shared == spheres_.end()) {
    shared = spheres_.emplace(subdivisions, add_attributes(icosphere(subdivisions), true)).first;
  }
  Json primitive = shared->second;
  primitive["material"] = add_material(material);
  meshes_.push_back({{"name", name}, {"primitives", Json::array({primitive})}});
  add_node(
      {{"name", name}, {"mesh", meshes_.size() - 1}, {"translation", array(centre)}, {"scale", array(Vec3(radius))}});
}

void GltfBuilder::set_camera(const Vec3& eye, const Vec3& target, double yfov, double aspect_ratio) {
  cameras_ = Json::array();
  cameras_.push_back({{"name", "camera"},
                      {"type", "perspective"},
                      {"perspective", {{"aspectRatio", aspect_ratio}, {"yfov", yfov}, {"znear", 0.001}}}});
  add_node({{"name", "camera"}, {"camera", 0}, {"matrix", placement(eye, target - eye)}});
}

void GltfBuilder::add_directional_light(const std::string& name, const Vec3& direction, const Vec3& irradiance) {
  const double strength = std::max({irradiance.x, irradiance.y, irradiance.z});
  extensions_.insert("KHR_lights_punctual");
  lights_.push_back(
      {{"name", name}, {"type", "directional"}, {"color", array(irradiance / strength)}, {"intensity", strength}});
  Json node = {{"name", name}, {"matrix", placement(Vec3(0.0), direction)}};
  node["extensions"]["KHR_lights_punctual"]["light"] = lights_.size() - 1;
  add_node(std::move(node));
}

std::string GltfBuilder::pack() const {
  Json root;
  root["asset"] = {{"version", "2.0"}, {"generator", "photonfarm-make-scenes"}};
  if (!extensions_.empty()) root["extensionsUsed"] = extensions_;
  if (!lights_.empty()) root["extensions"]["KHR_lights_punctual"]["lights"] = lights_;
  Json all = Json::array();
  for (std::size_t i = 0; i < nodes_.size(); ++i) all.push_back(i);
  root["scene"] = 0;
  root["scenes"] = Json::array({{{"nodes", all}}});
  root["nodes"] = nodes_;
  root["meshes"] = meshes_;
  root["materials"] = materials_;
  root["cameras"] = cameras_;
  root["accessors"] = accessors_;
  root["bufferViews"] = views_;
  root["buffers"] = Json::array({{{"byteLength", binary_.size()}}});
  std::string text = root.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');

  // glTF 2.0, 4.4: a header of 12 bytes, then chunks of length, type, data.
  constexpr std::uint32_t kMagic = 0x46546C67, kJsonChunk = 0x4E4F534A, kBinaryChunk = 0x004E4942;
  std::string glb;
  append(glb, kMagic);
  append(glb, std::uint32_t{2});
  append(glb, static_cast<std::uint32_t>(12 + 8 + text.size() + 8 + binary_.size()));
  append(glb, static_cast<std::uint32_t>(text.size()));
  append(glb, kJsonChunk);
  glb += text;
  append(glb, static_cast<std::uint32_t>(binary_.size()));
  append(glb, kBinaryChunk);
  glb += binary_;
  return glb;
}

}  // namespace pf::scenes
