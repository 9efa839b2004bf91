#include "worker/scene/gltf_attributes.h"

#include <fmt/format.h>

namespace pf::gltf {

Result<Attributes> Attributes::open(const Model& model, const tinygltf::Primitive& primitive, AccessorReader& accessors,
                                    const Report& report, const std::string& pointer) {
  Attributes out;
  out.primitive_ = &primitive;
  out.accessors_ = &accessors;
  out.report_ = &report;
  out.pointer_ = pointer;
  const tinygltf::Value* draco = find(primitive.extensions, "KHR_draco_mesh_compression");
  if (draco == nullptr) return out;
  const std::string at = pointer + "/extensions/KHR_draco_mesh_compression";
  if (primitive.indices < 0) return report.fail(at, "primitive has no indices; compressed ones need them");
  if (primitive.mode != TINYGLTF_MODE_TRIANGLES && primitive.mode != TINYGLTF_MODE_TRIANGLE_STRIP) {
    return report.fail(at,
                       fmt::format("primitive has mode {}; compressed ones are triangles or a strip", primitive.mode));
  }
  const auto view_index = static_cast<std::size_t>(int_or(*draco, "bufferView", 0));
  const tinygltf::BufferView& view = model.gltf.bufferViews[view_index];
  const Bytes& data = model.gltf.buffers[static_cast<std::size_t>(view.buffer)].data;
  if (view.byteOffset + view.byteLength > data.size()) return report.fail(at, "its buffer has no data");
  const std::size_t points = accessors.count(primitive.attributes.at("POSITION"));
  const std::size_t indices = accessors.count(primitive.indices);
  // Every attribute is made from the declared count: ask before anything is decoded.
  if (auto granted = accessors.spend(std::uint64_t{points} * primitive.attributes.size() + indices, at); !granted) {
    return tl::unexpected(granted.error());
  }
  auto mesh = DracoMesh::decode(std::span(data).subspan(view.byteOffset, view.byteLength), points, indices, report, at);
  if (!mesh) return tl::unexpected(mesh.error());
  out.draco_ = std::move(*mesh);
  return out;
}

std::size_t Attributes::vertex_count() const { return accessors_->count(primitive_->attributes.at("POSITION")); }

std::optional<int> Attributes::draco_id(const std::string& name) const {
  if (!draco_) return std::nullopt;
  const tinygltf::Value* map = find(*find(primitive_->extensions, "KHR_draco_mesh_compression"), "attributes");
  if (map == nullptr || !map->Has(name)) return std::nullopt;
  return int_or(*map, name, -1);
}

float Attributes::scale(int accessor) const {
  const tinygltf::Accessor& a = accessors_->accessor(accessor);
  if (!a.normalized) return 1.0f;
  switch (a.componentType) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      return 1.0f / 127.0f;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return 1.0f / 255.0f;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      return 1.0f / 32767.0f;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return 1.0f / 65535.0f;
    default:
      return 1.0f;
  }
}

}  // namespace pf::gltf
