// Any bytes as a glTF or GLB file: no crash, no hang, no flood of memory; either a one-line error or a scene
// that keeps every promise of scene_description.h.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <string>

#include "worker/scene/gltf_loader.h"

namespace {

void require(bool holds) {
  if (!holds) std::abort();
}

bool one_line(const std::string& text) {
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 0x20) return false;
  }
  return !text.empty();
}

void check(const pf::Mesh& mesh, const pf::SceneDescription& scene) {
  const std::size_t n = mesh.positions.size();
  for (const pf::Vec3f& p : mesh.positions) require(pf::is_finite(p));
  require(mesh.normals.empty() || mesh.normals.size() == n);
  for (const pf::Vec3f& v : mesh.normals) require(std::abs(pf::length(v) - 1.0f) < 1e-3f);
  require(mesh.tangents.empty() || (mesh.tangents.size() == n && mesh.normals.size() == n));
  for (const pf::Vec4f& t : mesh.tangents) {
    require(std::abs(pf::length(pf::Vec3f(t.x, t.y, t.z)) - 1.0f) < 1e-3f && std::abs(t.w) == 1.0f);
  }
  for (const auto& uv : mesh.uv) require(uv.empty() || uv.size() == n);
  require(mesh.colors.empty() || mesh.colors.size() == n);
  require(!mesh.triangles.empty());
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t i : t) require(i < n);
  }
  require(mesh.material >= 0 && static_cast<std::size_t>(mesh.material) < scene.materials.size());
}

void check(const pf::TextureRef& ref, const pf::SceneDescription& scene) {
  if (!ref.present()) return;
  require(static_cast<std::size_t>(ref.texture) < scene.textures.size());
  require(ref.uv_set >= 0 && ref.uv_set < pf::kMaxUvSets);
}

void check(const pf::SceneDescription& scene) {
  for (const pf::Mesh& mesh : scene.meshes) check(mesh, scene);
  require(!scene.materials.empty() && !scene.cameras.empty());
  for (const pf::Material& m : scene.materials) {
    check(m.base_color_texture, scene);
    check(m.normal_texture, scene);
    check(m.clearcoat_normal_texture, scene);
    check(m.sheen_roughness_texture, scene);
    require(pf::is_finite(m.emission) && pf::min_component(m.emission) >= 0.0f);
  }
  for (const pf::MeshInstance& i : scene.instances) {
    require(i.mesh >= 0 && static_cast<std::size_t>(i.mesh) < scene.meshes.size());
    require(i.object_to_world.determinant() != 0.0f);
  }
  for (const pf::PunctualLight& l : scene.lights) {
    require(pf::is_finite(l.intensity) && pf::is_finite(l.position));
    require(std::abs(pf::length(l.direction) - 1.0f) < 1e-3f && l.cos_inner >= l.cos_outer);
  }
  for (const pf::Camera& c : scene.cameras) require(std::isfinite(c.camera_to_world.determinant()));
  for (const std::string& w : scene.warnings) require(one_line(w));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto scene = pf::load_gltf_from_memory(std::span(data, size), {});
  if (scene) {
    check(*scene);
  } else {
    require(scene.error().kind == pf::ErrorKind::kInvalidInput && one_line(scene.error().message));
  }
  return 0;
}
