#include "worker/scene/gltf_nodes.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "worker/scene/gltf_camera.h"

namespace pf::gltf {
namespace {

Matrix44f to_float(const Imath::M44d& m) {
  Matrix44f out;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) out[r][c] = static_cast<float>(m[r][c]);
  }
  return out;
}

bool is_finite_matrix(const Matrix44f& m) {
  return std::all_of(&m[0][0], &m[0][0] + 16, [](float x) { return std::isfinite(x); });
}

/// Can the upper 3x3 be inverted in single precision? Its determinant is held against float's range, and against the
/// lengths of its rows.
bool is_invertible(const Matrix44f& m) {
  Imath::V3d row[3];
  for (int r = 0; r < 3; ++r) row[r] = Imath::V3d(m[r][0], m[r][1], m[r][2]);
  const double volume = std::abs(row[0].dot(row[1].cross(row[2])));
  const float determinant = m.determinant();  // as whoever inverts it computes it, underflow included
  return determinant != 0.0f && std::isfinite(determinant) && volume > 1e-30 && volume < 1e30 &&
         volume > 1e-6 * row[0].length() * row[1].length() * row[2].length();
}

std::string label(const std::string& name, const char* kind, std::size_t index) {
  return name.empty() ? fmt::format("{} {}", kind, index) : name;
}

}  // namespace

Imath::M44d trs(const Imath::V3d& t, const Imath::V4d& rotation, const Imath::V3d& s) {
  const Imath::V4d q = rotation / std::sqrt(rotation.dot(rotation));
  const double x = q.x, y = q.y, z = q.z, w = q.w;
  // Rows are where the axes go.
  const Imath::V3d ax(1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w));
  const Imath::V3d ay(2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w));
  const Imath::V3d az(2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y));
  return {ax.x * s.x, ax.y * s.x, ax.z * s.x, 0, ay.x * s.y, ay.y * s.y, ay.z * s.y, 0,
          az.x * s.z, az.y * s.z, az.z * s.z, 0, t.x,        t.y,        t.z,        1};
}

Imath::M44d local_transform(const tinygltf::Node& node) {
  if (node.matrix.size() == 16) {
    Imath::M44d m;
    for (int i = 0; i < 16; ++i) m[i / 4][i % 4] = node.matrix[static_cast<std::size_t>(i)];
    m[0][3] = m[1][3] = m[2][3] = 0;
    m[3][3] = 1;
    return m;
  }
  const auto& t = node.translation;
  const auto& r = node.rotation;
  const auto& s = node.scale;
  return trs(t.size() == 3 ? Imath::V3d(t[0], t[1], t[2]) : Imath::V3d(0, 0, 0),
             r.size() == 4 ? Imath::V4d(r[0], r[1], r[2], r[3]) : Imath::V4d(0, 0, 0, 1),
             s.size() == 3 ? Imath::V3d(s[0], s[1], s[2]) : Imath::V3d(1, 1, 1));
}

void NodeReader::compute_transforms() {
  const auto& nodes = model_.gltf.nodes;
  std::vector<bool> is_child(nodes.size(), false);
  for (const auto& node : nodes) {
    for (const int c : node.children) is_child[static_cast<std::size_t>(c)] = true;
  }
  to_world_.assign(nodes.size(), Imath::M44d());
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (is_child[i]) continue;
    to_world_[i] = local_transform(nodes[i]);
    order.push_back(i);
  }
  for (std::size_t k = 0; k < order.size(); ++k) {
    for (const int c : nodes[order[k]].children) {
      const auto i = static_cast<std::size_t>(c);
      to_world_[i] = local_transform(nodes[i]) * to_world_[order[k]];
      order.push_back(i);
    }
  }
}

Result<std::vector<int>> NodeReader::roots(const std::string& wanted) {
  const auto& scenes = model_.gltf.scenes;
  if (!wanted.empty()) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < scenes.size(); ++i) {
      if (scenes[i].name == wanted) return scenes[i].nodes;
      names.push_back(fmt::format("{} ({})", in_quotes(scenes[i].name), i));
    }
    const bool number =
        wanted.size() < 9 && std::all_of(wanted.begin(), wanted.end(), [](char c) { return c >= '0' && c <= '9'; });
    if (number && std::stoul(wanted) < scenes.size()) return scenes[std::stoul(wanted)].nodes;
    return report_.fail("/scenes",
                        fmt::format("no scene {}; the file has {}", in_quotes(wanted), fmt::join(names, ", ")));
  }
  if (!scenes.empty()) {
    const int index = model_.gltf.defaultScene;
    return scenes[index >= 0 ? static_cast<std::size_t>(index) : 0].nodes;
  }
  if (model_.gltf.nodes.empty()) return std::vector<int>();
  report_.warn("", "the file has no scenes; all its nodes are taken");
  std::vector<int> all(model_.gltf.nodes.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<int>(i);
  return all;
}

Result<void> NodeReader::read(const std::string& scene, SceneDescription& out) {
  const auto& nodes = model_.gltf.nodes;
  auto stack = roots(scene);
  if (!stack) return tl::unexpected(stack.error());
  compute_transforms();
  mesh_used_.assign(model_.gltf.meshes.size(), false);
  std::vector<bool> shown(nodes.size(), false);
  while (!stack->empty()) {
    const auto i = static_cast<std::size_t>(stack->back());
    stack->pop_back();
    if (shown[i]) continue;
    shown[i] = true;
    stack->insert(stack->end(), nodes[i].children.begin(), nodes[i].children.end());
  }
  // Document order: what comes first in the file comes first in the scene.
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (!shown[i]) continue;
    if (!is_finite_matrix(to_float(to_world_[i]))) {
      report_.warn(child("/nodes", i), "is left out: its transform leaves single precision");
      continue;
    }
    if (nodes[i].skin >= 0 && nodes[i].mesh >= 0) {
      const auto& joints = model_.gltf.skins[static_cast<std::size_t>(nodes[i].skin)].joints;
      const auto outside = [&](int j) { return !shown[static_cast<std::size_t>(j)]; };
      if (std::any_of(joints.begin(), joints.end(), outside)) {
        report_.warn(child("/nodes", i),
                     "joints of its skin are not in the scene; their transforms count nevertheless");
      }
    }
    if (nodes[i].mesh >= 0) {
      if (auto placed = place_mesh(i, out); !placed) return placed;
    }
    if (nodes[i].camera >= 0) place_camera(i, out);
    place_light(i, out);
  }
  return {};
}

Result<SkinPose> NodeReader::pose(std::size_t index) {
  const tinygltf::Skin& skin = model_.gltf.skins[index];
  std::vector<Matrix44f> bind(skin.joints.size());
  if (skin.inverseBindMatrices >= 0) {
    auto read =
        accessors_.vectors<Matrix44f>(skin.inverseBindMatrices, fmt::format("/skins/{}/inverseBindMatrices", index));
    if (!read) return tl::unexpected(read.error());
    std::copy_n(read->begin(), bind.size(), bind.begin());
  }
  SkinPose out;
  for (std::size_t j = 0; j < bind.size(); ++j) {
    bind[j][0][3] = bind[j][1][3] = bind[j][2][3] = 0.0f;
    bind[j][3][3] = 1.0f;
    out.push_back(to_float(Imath::M44d(bind[j]) * to_world_[static_cast<std::size_t>(skin.joints[j])]));
  }
  return out;
}

Result<std::vector<int>> NodeReader::meshes_of(std::size_t index, SceneDescription& out) {
  const tinygltf::Node& node = model_.gltf.nodes[index];
  const auto mesh = static_cast<std::size_t>(node.mesh);
  mesh_used_[mesh] = true;
  const bool own = node.skin >= 0 || !node.weights.empty();
  if (!own && shared_.contains(mesh)) return shared_[mesh];
  std::optional<SkinPose> skin;
  if (node.skin >= 0) {
    auto posed = pose(static_cast<std::size_t>(node.skin));
    if (!posed) return tl::unexpected(posed.error());
    skin = std::move(*posed);
  }
  auto read = geometry_.read(mesh, node.weights, skin ? &*skin : nullptr);
  if (!read) return tl::unexpected(read.error());
  std::vector<int> indices;
  for (Mesh& m : *read) {
    indices.push_back(static_cast<int>(out.meshes.size()));
    out.meshes.push_back(std::move(m));
  }
  if (!own) shared_[mesh] = indices;
  return indices;
}

Result<std::vector<Matrix44f>> NodeReader::placements(std::size_t index) {
  const tinygltf::Node& node = model_.gltf.nodes[index];
  // A skinned mesh stands where its joints are [glTF 2.0, 3.7.3.3].
  if (node.skin >= 0) return std::vector<Matrix44f>{Matrix44f()};
  const tinygltf::Value* instancing = find(node.extensions, "EXT_mesh_gpu_instancing");
  if (instancing == nullptr) return std::vector<Matrix44f>{to_float(to_world_[index])};
  const tinygltf::Value& attributes = instancing->Get("attributes");
  const std::string pointer = child("/nodes", index) + "/extensions/EXT_mesh_gpu_instancing/attributes";
  std::vector<Vec3f> translation;
  std::vector<Vec4f> rotation;
  std::vector<Vec3f> scale;
  const auto read = [&](const char* name, auto& into) -> Result<void> {
    using V = typename std::remove_reference_t<decltype(into)>::value_type;
    if (!attributes.Has(name)) return {};
    auto values = accessors_.vectors<V>(attributes.Get(name).GetNumberAsInt(), child(pointer, name));
    if (!values) return tl::unexpected(values.error());
    into = std::move(*values);
    return {};
  };
  if (auto r = read("TRANSLATION", translation); !r) return tl::unexpected(r.error());
  if (auto r = read("ROTATION", rotation); !r) return tl::unexpected(r.error());
  if (auto r = read("SCALE", scale); !r) return tl::unexpected(r.error());
  std::vector<Matrix44f> out(std::max({translation.size(), rotation.size(), scale.size()}));
  for (std::size_t i = 0; i < out.size(); ++i) {
    Imath::V4d q = i < rotation.size() ? Imath::V4d(rotation[i]) : Imath::V4d(0, 0, 0, 1);
    if (q.dot(q) == 0) {
      return report_.fail(child(pointer, "ROTATION"), fmt::format("instance {} has a quaternion of length 0", i));
    }
    out[i] = to_float(trs(i < translation.size() ? Imath::V3d(translation[i]) : Imath::V3d(0, 0, 0), q,
                          i < scale.size() ? Imath::V3d(scale[i]) : Imath::V3d(1, 1, 1)) *
                      to_world_[index]);
  }
  return out;
}

Result<void> NodeReader::place_mesh(std::size_t index, SceneDescription& out) {
  const auto meshes = meshes_of(index, out);
  if (!meshes) return tl::unexpected(meshes.error());
  const auto matrices = placements(index);
  if (!matrices) return tl::unexpected(matrices.error());
  // A node counts once for each primitive, an instance is 17 numbers.
  if (auto r = accessors_.spend(std::uint64_t{meshes->size()} * matrices->size(), child("/nodes", index)); !r) return r;
  std::size_t dropped = 0;
  for (const Matrix44f& m : *matrices) {
    if (!is_finite_matrix(m) || !is_invertible(m)) {
      ++dropped;
      continue;
    }
    for (const int mesh : *meshes) out.instances.push_back({mesh, m});
  }
  if (dropped > 0) {
    report_.warn(child("/nodes", index),
                 fmt::format("{} is left out: its transform cannot be inverted (a scale of 0?)",
                             matrices->size() == 1 ? "mesh" : fmt::format("mesh ({} instances)", dropped)));
  }
  return {};
}

void NodeReader::place_camera(std::size_t index, SceneDescription& out) {
  const tinygltf::Node& node = model_.gltf.nodes[index];
  const auto camera_index = static_cast<std::size_t>(node.camera);
  const tinygltf::Camera& camera = model_.gltf.cameras[camera_index];
  // One camera on several nodes: the nodes' names tell the views apart.
  std::string name = label(camera.name.empty() ? node.name : camera.name, "camera", camera_index);
  const auto taken = [&](const std::string& n) {
    return std::any_of(out.cameras.begin(), out.cameras.end(), [&](const Camera& c) { return c.name == n; });
  };
  if (taken(name) && !node.name.empty()) name = node.name;
  if (taken(name)) name = fmt::format("{} ({})", name, index);
  auto read = read_camera(camera, name, to_float(to_world_[index]), child("/nodes", index), report_);
  if (read) out.cameras.push_back(std::move(*read));
}

void NodeReader::place_light(std::size_t index, SceneDescription& out) {
  const tinygltf::Value* reference = find(model_.gltf.nodes[index].extensions, "KHR_lights_punctual");
  if (reference == nullptr) return;
  const tinygltf::Light& in = model_.gltf.lights[static_cast<std::size_t>(int_or(*reference, "light", 0))];
  PunctualLight light;
  light.kind = in.type == "directional" ? PunctualKind::kDirectional
               : in.type == "spot"      ? PunctualKind::kSpot
                                        : PunctualKind::kPoint;
  const Rgb color = in.color.size() == 3 ? Rgb(static_cast<float>(in.color[0]), static_cast<float>(in.color[1]),
                                               static_cast<float>(in.color[2]))
                                         : Rgb(1.0f, 1.0f, 1.0f);
  light.intensity = color * static_cast<float>(in.intensity);
  const Imath::M44d& m = to_world_[index];
  light.position = Vec3f(static_cast<float>(m[3][0]), static_cast<float>(m[3][1]), static_cast<float>(m[3][2]));
  const Imath::V3d z(-m[2][0], -m[2][1], -m[2][2]);  // shines along local -z
  const double l = z.length();
  if (light.kind != PunctualKind::kPoint && !(l > 0)) {
    report_.warn(child("/nodes", index), "light is left out: its transform has no direction");
    return;
  }
  if (l > 0) light.direction = Vec3f(z / l);
  if (light.kind == PunctualKind::kSpot) {
    light.cos_inner = static_cast<float>(std::cos(in.spot.innerConeAngle));
    light.cos_outer = static_cast<float>(std::max(0.0, std::cos(in.spot.outerConeAngle)));
  }
  out.lights.push_back(light);
}

void NodeReader::check_unused() {
  for (std::size_t i = 0; i < mesh_used_.size(); ++i) {
    if (mesh_used_[i]) continue;
    const auto read = geometry_.read(i, {}, nullptr);
    if (!read) report_.warn(read.error(), "nothing in the scene uses it");
  }
}

}  // namespace pf::gltf
