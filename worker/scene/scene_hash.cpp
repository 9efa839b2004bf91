#include "worker/scene/scene_hash.h"

#include <span>

#include "common/base/hash.h"

namespace pf {
namespace {

template <typename T>
void add(Sha256& hash, const std::vector<T>& values) {
  const std::uint64_t count = values.size();
  hash.update(std::as_bytes(std::span(&count, 1)));
  hash.update(std::as_bytes(std::span(values)));
}

Result<void> add_file(Sha256& hash, const std::string& file) {
  if (file.empty()) return {};
  auto digest = sha256_hex_of_file(file);
  if (!digest) return tl::unexpected(digest.error());
  hash.update(std::string_view(*digest));
  return {};
}

}  // namespace

Result<std::string> hash_scene(const std::filesystem::path& gltf, const SceneDescription& description) {
  Sha256 hash;
  if (auto added = add_file(hash, gltf.string()); !added) return tl::unexpected(added.error());
  for (const Mesh& mesh : description.meshes) {
    add(hash, mesh.positions);
    add(hash, mesh.normals);
    add(hash, mesh.tangents);
    for (const auto& set : mesh.uv) add(hash, set);
    add(hash, mesh.colors);
    add(hash, mesh.triangles);
  }
  for (const MeshInstance& instance : description.instances) {
    hash.update(std::as_bytes(std::span(instance.object_to_world.getValue(), 16)));
  }
  for (const Texture& texture : description.textures) {
    if (auto added = add_file(hash, texture.file); !added) return tl::unexpected(added.error());
  }
  if (auto added = add_file(hash, description.environment.file); !added) return tl::unexpected(added.error());
  return hash.hex();
}

}  // namespace pf
