#pragma once

#include <optional>
#include <string>
#include <vector>

#include "worker/scene/gltf_accessor.h"
#include "worker/scene/gltf_draco.h"

namespace pf::gltf {

/// The vertex attributes of one primitive, whether they stand in accessors or in Draco data.
class Attributes {
 public:
  [[nodiscard]] static Result<Attributes> open(const Model& model, const tinygltf::Primitive& primitive,
                                               AccessorReader& accessors, const Report& report,
                                               const std::string& pointer);

  [[nodiscard]] bool has(const std::string& name) const { return primitive_->attributes.contains(name); }
  [[nodiscard]] std::size_t vertex_count() const;
  [[nodiscard]] bool compressed() const { return draco_.has_value(); }
  [[nodiscard]] const DracoMesh& draco() const { return *draco_; }

  template <typename V>
  [[nodiscard]] Result<std::vector<V>> vectors(const std::string& name, float fill = 0.0f) const {
    const int accessor = primitive_->attributes.at(name);
    const std::string at = child(pointer_ + "/attributes", name);
    const std::optional<int> id = draco_id(name);
    if (!id) return accessors_->vectors<V>(accessor, at, fill);
    std::vector<V> out(vertex_count());
    const auto done = draco_->read(*id, accessors_->components(accessor), scale(accessor), fill,
                                   reinterpret_cast<float*>(out.data()), sizeof(V) / sizeof(float), *report_, at);
    if (!done) return tl::unexpected(done.error());
    return out;
  }

 private:
  Attributes() = default;
  /// Id of an attribute in the Draco data; empty where it stands in an accessor.
  [[nodiscard]] std::optional<int> draco_id(const std::string& name) const;
  /// What turns a normalized integer into a fraction.
  [[nodiscard]] float scale(int accessor) const;

  const tinygltf::Primitive* primitive_ = nullptr;
  AccessorReader* accessors_ = nullptr;
  const Report* report_ = nullptr;
  std::string pointer_;
  std::optional<DracoMesh> draco_;
};

}  // namespace pf::gltf
