#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "worker/scene/gltf_accessor.h"
#include "worker/scene/gltf_attributes.h"
#include "worker/scene/gltf_model.h"
#include "worker/scene/scene_description.h"

namespace pf::gltf {

/// Matrices of a skin's joints in the rest pose: inverse bind matrix, then the joint's world transform.
using SkinPose = std::vector<Matrix44f>;

/// Turns glTF primitives into Meshes: attributes of any form or Draco data, strips and fans, morph targets,
/// skin, normals and tangents.
class GeometryReader {
 public:
  GeometryReader(const Model& model, const std::vector<Material>& materials, AccessorReader& accessors, Report& report)
      : model_(model), materials_(materials), accessors_(accessors), report_(report) {}

  /// The triangle primitives of glTF mesh `mesh`. `weights`: of the node, else empty (the mesh's own count).
  /// `skin`: null where the node has none.
  [[nodiscard]] Result<std::vector<Mesh>> read(std::size_t mesh, const std::vector<double>& weights,
                                               const SkinPose* skin);

  /// One warning for each kind of thing that read() left out.
  void report_counts();

 private:
  [[nodiscard]] Result<std::optional<Mesh>> read_primitive(const tinygltf::Primitive& primitive,
                                                           const std::string& pointer,
                                                           const std::vector<double>& weights, const SkinPose* skin);
  [[nodiscard]] Result<void> read_vertices(const Attributes& attributes, Mesh& mesh);
  [[nodiscard]] Result<void> read_triangles(const tinygltf::Primitive& primitive, const Attributes& attributes,
                                            Mesh& mesh, const std::string& pointer);
  [[nodiscard]] Result<void> apply_morph(const tinygltf::Primitive& primitive, const std::vector<double>& weights,
                                         Mesh& mesh, const std::string& pointer);
  [[nodiscard]] Result<void> apply_skin(const Attributes& attributes, const SkinPose& skin, Mesh& mesh,
                                        const std::string& pointer);
  void drop_degenerate(Mesh& mesh);
  void repair_normals(Mesh& mesh);
  void check_units(const Mesh& mesh, const std::string& pointer);
  void repair_colors(Mesh& mesh, const std::string& pointer);
  /// Every UV set that the material reads exists afterwards.
  [[nodiscard]] Result<void> complete_uv(Mesh& mesh, const std::string& pointer);
  [[nodiscard]] bool has_data(const tinygltf::Primitive& primitive) const;
  void finish_tangents(Mesh& mesh);

  const Model& model_;
  const std::vector<Material>& materials_;
  AccessorReader& accessors_;
  Report& report_;
  std::size_t points_and_lines_ = 0;
  std::size_t degenerate_ = 0;
};

}  // namespace pf::gltf
