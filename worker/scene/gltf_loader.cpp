#include "worker/scene/gltf_loader.h"

#include <algorithm>
#include <exception>
#include <system_error>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "worker/scene/gltf_audit.h"
#include "worker/scene/gltf_camera.h"
#include "worker/scene/gltf_extensions.h"
#include "worker/scene/gltf_geometry.h"
#include "worker/scene/gltf_material.h"
#include "worker/scene/gltf_model.h"
#include "worker/scene/gltf_nodes.h"
#include "worker/scene/gltf_schema.h"
#include "worker/scene/gltf_validation.h"

namespace pf {
namespace {

using gltf::Report;

Result<void> check_camera(const SceneDescription& scene, const std::string& wanted, const Report& report) {
  if (wanted.empty()) return {};
  std::vector<std::string> names;
  for (const Camera& camera : scene.cameras) {
    if (camera.name == wanted) return {};
    names.push_back(gltf::in_quotes(camera.name));
  }
  if (names.empty())
    return report.fail("/cameras", fmt::format("no camera {}; the scene has none", gltf::in_quotes(wanted)));
  return report.fail("/cameras",
                     fmt::format("no camera {}; the scene has {}", gltf::in_quotes(wanted), fmt::join(names, ", ")));
}

Result<SceneDescription> read_scene(const gltf::Model& model, const gltf::Folder& folder, const std::string& scene,
                                    Report& report) {
  SceneDescription out;
  gltf::TextureTable textures(model, folder, report);
  for (std::size_t i = 0; i < model.gltf.materials.size(); ++i) {
    auto material = gltf::read_material(model, i, textures, report);
    if (!material) return tl::unexpected(material.error());
    out.materials.push_back(std::move(*material));
  }
  out.materials.emplace_back().name = "default material";
  textures.check_unused();
  out.textures = textures.take();
  gltf::AccessorReader accessors(model, report);
  gltf::GeometryReader geometry(model, out.materials, accessors, report);
  gltf::NodeReader nodes(model, geometry, accessors, report);
  if (auto read = nodes.read(scene, out); !read) return tl::unexpected(read.error());
  geometry.report_counts();
  // What a mesh uses has been checked; this keeps the rest in range as well.
  for (std::size_t i = 0; i < out.materials.size(); ++i) {
    for (TextureRef* ref : gltf::texture_refs(out.materials[i])) {
      if (ref->uv_set < kMaxUvSets) continue;
      report.warn(gltf::child("/materials", i),
                  fmt::format("reads TEXCOORD_{}; at most {} sets are supported", ref->uv_set, kMaxUvSets));
      *ref = {};
    }
  }
  nodes.check_unused();
  gltf::audit(model, accessors, report);
  if (out.instances.empty()) report.warn("", "the scene has no surfaces: nothing will be seen");
  return out;
}

Result<SceneDescription> load(std::span<const std::uint8_t> bytes, const gltf::Folder& folder, const std::string& name,
                              const std::string& scene, const std::string& camera) {
  Report report(name);
  try {
    auto container = gltf::split(bytes, report);
    if (!container) return tl::unexpected(container.error());
    gltf::check_extensions(container->document, report);
    if (!report.failed()) gltf::check_schema(container->document, report);
    if (!report.failed()) gltf::check_document(container->document, report);
    if (auto checked = report.result(); !checked) return tl::unexpected(checked.error());
    const auto model = gltf::make_model(std::move(*container), bytes.size(), folder, report);
    if (!model) return tl::unexpected(model.error());
    auto out = read_scene(*model, folder, scene, report);
    if (!out) return out;
    if (auto found = check_camera(*out, camera, report); !found) return tl::unexpected(found.error());
    if (out->cameras.empty()) out->cameras.push_back(gltf::framed_camera(gltf::bounds_of(*out)));
    out->warnings = report.take_warnings();
    return out;
  } catch (const std::exception& e) {  // bad_alloc above all
    return report.fail("", fmt::format("cannot be read: {}", e.what()));
  }
}

}  // namespace

Result<SceneDescription> load_gltf(const GltfRequest& request) {
  namespace fs = std::filesystem;
  const std::string name = request.file.generic_string();
  const Report report(name);
  std::error_code error;
  if (!fs::exists(request.file, error)) return report.fail("", "file is not found");
  const fs::path file = fs::canonical(request.file, error);
  const fs::path root = request.root.empty() ? file.parent_path() : request.root;
  if (!gltf::is_inside(file, root)) return report.fail("", "lies outside the folder that may be read");
  if (const auto size = fs::file_size(file, error); !error && size > gltf::kMaxFileBytes)
    return report.fail("", "file is larger than 4 GiB");
  const auto bytes = gltf::read_file(file, gltf::kMaxFileBytes);
  if (!bytes) return report.fail("", bytes.error());
  return load(*bytes, gltf::Folder(file.parent_path(), root), name, request.scene, request.camera);
}

Result<SceneDescription> load_gltf_from_memory(std::span<const std::uint8_t> bytes,
                                               const std::filesystem::path& folder) {
  return load(bytes, gltf::Folder(folder, folder), "glTF in memory", "", "");
}

bool has_light(const SceneDescription& scene) {
  if (!scene.lights.empty() || scene.environment.present()) return true;
  return std::any_of(scene.instances.begin(), scene.instances.end(), [&](const MeshInstance& instance) {
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
    return material.unlit || !is_zero(material.emission);
  });
}

}  // namespace pf
