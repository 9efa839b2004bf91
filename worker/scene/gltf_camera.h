#pragma once

#include <optional>
#include <string>

#include "common/math/vec.h"
#include "worker/scene/gltf_model.h"
#include "worker/scene/scene_description.h"

namespace pf::gltf {

/// glTF camera at a node's world transform, whose scale is taken out; empty (with a warning) where that
/// leaves no view.
[[nodiscard]] std::optional<Camera> read_camera(const tinygltf::Camera& in, std::string name,
                                                const Matrix44f& node_to_world, const std::string& pointer,
                                                Report& report);

/// A camera that sees all of `bounds`: from +z and slightly above, 50 degrees.
[[nodiscard]] Camera framed_camera(const Box3f& bounds);

/// World-space box of all instances, from the boxes of their meshes.
[[nodiscard]] Box3f bounds_of(const SceneDescription& scene);

}  // namespace pf::gltf
