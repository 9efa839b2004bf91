#pragma once

#include <map>
#include <string>
#include <vector>

#include <Imath/ImathMatrix.h>

#include "common/base/result.h"
#include "worker/scene/gltf_geometry.h"
#include "worker/scene/gltf_model.h"
#include "worker/scene/scene_description.h"

namespace pf::gltf {

/// Walks the nodes of one glTF scene and fills a SceneDescription with what hangs on them.
class NodeReader {
 public:
  NodeReader(const Model& model, GeometryReader& geometry, AccessorReader& accessors, Report& report)
      : model_(model), geometry_(geometry), accessors_(accessors), report_(report) {}

  /// `scene`: name or index; empty: the default one, else the first, else all root nodes.
  [[nodiscard]] Result<void> read(const std::string& scene, SceneDescription& out);
  /// A warning for each mesh that the scene does not place and that could not be read.
  void check_unused();

 private:
  [[nodiscard]] Result<std::vector<int>> roots(const std::string& scene);
  [[nodiscard]] Result<void> place_mesh(std::size_t node, SceneDescription& out);
  /// Indices into out.meshes of the primitives that `node` shows.
  [[nodiscard]] Result<std::vector<int>> meshes_of(std::size_t node, SceneDescription& out);
  [[nodiscard]] Result<SkinPose> pose(std::size_t skin);
  [[nodiscard]] Result<std::vector<Matrix44f>> placements(std::size_t node);
  void place_camera(std::size_t node, SceneDescription& out);
  void place_light(std::size_t node, SceneDescription& out);
  void compute_transforms();

  const Model& model_;
  GeometryReader& geometry_;
  AccessorReader& accessors_;
  Report& report_;
  std::vector<Imath::M44d> to_world_;               // of every node; sums of many products, hence doubles
  std::map<std::size_t, std::vector<int>> shared_;  // meshes without skin and node weights, by glTF index
  std::vector<bool> mesh_used_;
};

/// Local transform of a node, row-vector convention.
[[nodiscard]] Imath::M44d local_transform(const tinygltf::Node& node);
/// scale, then rotation by quaternion (x, y, z, w; normalised here), then translation.
[[nodiscard]] Imath::M44d trs(const Imath::V3d& translation, const Imath::V4d& rotation, const Imath::V3d& scale);

}  // namespace pf::gltf
