#include <algorithm>
#include <cmath>
#include <set>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "worker/scene/gltf_validation.h"

namespace pf::gltf {
namespace {

constexpr int kNoParent = -1;

/// Parent of each node; a second parent is an error.
std::vector<int> parents_of(const Json& nodes, Report& report) {
  std::vector<int> parent(nodes.size(), kNoParent);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (!nodes[i].contains("children")) continue;
    for (const Json& child_index : nodes[i]["children"]) {
      const auto c = child_index.get<std::size_t>();
      if (parent[c] != kNoParent) {
        report.error(fmt::format("/nodes/{}/children", i),
                     fmt::format("node {} is already a child of node {}; expected one parent", c, parent[c]));
        return {};
      }
      parent[c] = static_cast<int>(i);
    }
  }
  return parent;
}

/// Nodes in an order in which every parent stands before its children; shorter than the list if there is a
/// cycle.
std::vector<std::size_t> parents_first(const Json& nodes, const std::vector<int>& parent) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (parent[i] == kNoParent) order.push_back(i);
  }
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Json& node = nodes[order[k]];
    if (!node.contains("children")) continue;
    for (const Json& c : node["children"]) order.push_back(c.get<std::size_t>());
  }
  return order;
}

/// Are two axes of a matrix not perpendicular?
bool has_shear(const Json& m) {
  const auto product = [&](int a, int b) {
    double sum = 0;
    for (int i = 0; i < 3; ++i) sum += m[4 * a + i].get<double>() * m[4 * b + i].get<double>();
    return sum;
  };
  for (const auto& [a, b] : {std::pair(0, 1), std::pair(0, 2), std::pair(1, 2)}) {
    if (std::abs(product(a, b)) > 1e-3 * std::sqrt(product(a, a) * product(b, b))) return true;
  }
  return false;
}

void check_transform(const Json& node, const std::string& pointer, Report& report) {
  const bool trs = node.contains("translation") || node.contains("rotation") || node.contains("scale");
  if (node.contains("matrix")) {
    if (trs) report.error(pointer, "has both a matrix and translation, rotation or scale; expected one or the other");
    const Json& m = node["matrix"];
    const auto differs = [&](int i, double expected) { return std::abs(m[i].get<double>() - expected) > 1e-4; };
    if (differs(3, 0) || differs(7, 0) || differs(11, 0) || differs(15, 1)) {
      report.error(child(pointer, "matrix"), "is not affine; expected 0, 0, 0, 1 as the last row");
    }
    if (has_shear(m))
      report.warn(child(pointer, "matrix"), "has shear: it is no product of translation, rotation and scale");
  }
  if (!node.contains("rotation")) return;
  double length2 = 0;
  for (const Json& x : node["rotation"]) length2 += x.get<double>() * x.get<double>();
  if (length2 == 0) {
    report.error(child(pointer, "rotation"), "is zero; expected a unit quaternion");
  } else if (std::abs(std::sqrt(length2) - 1.0) > 5e-4) {
    report.warn(child(pointer, "rotation"), fmt::format("has length {:.6g}; it is normalised", std::sqrt(length2)));
  }
}

/// Morph targets of the first primitive of a mesh.
std::size_t target_count(const Json& mesh) {
  const Json& primitives = mesh["primitives"];
  return primitives.empty() || !primitives[0].contains("targets") ? 0 : primitives[0]["targets"].size();
}

void check_node_mesh(const Json& document, const Json& node, const std::string& pointer, Report& report) {
  if (!node.contains("mesh")) {
    for (const char* key : {"skin", "weights"}) {
      if (node.contains(key)) report.warn(child(pointer, key), "has no meaning on a node without a mesh");
    }
    return;
  }
  const Json& mesh = elements(document, "meshes")[unsigned_or(node, "mesh", 0)];
  const std::size_t targets = target_count(mesh);
  if (node.contains("weights") && node["weights"].size() != targets) {
    report.error(child(pointer, "weights"),
                 fmt::format("has {} values; the mesh has {} morph targets", node["weights"].size(), targets));
  }
  const auto has_joints = [](const Json& p) { return p["attributes"].contains("JOINTS_0"); };
  const bool skinned = std::any_of(mesh["primitives"].begin(), mesh["primitives"].end(), has_joints);
  if (node.contains("skin") && !skinned)
    report.warn(child(pointer, "skin"), "its mesh has no JOINTS_0; the skin is ignored");
}

void check_scenes(const Json& document, const std::vector<int>& parent, Report& report) {
  const Json& scenes = elements(document, "scenes");
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    if (!scenes[i].contains("nodes")) continue;
    std::set<std::size_t> seen;
    for (std::size_t k = 0; k < scenes[i]["nodes"].size(); ++k) {
      const auto node = scenes[i]["nodes"][k].get<std::size_t>();
      const std::string pointer = fmt::format("/scenes/{}/nodes/{}", i, k);
      if (!seen.insert(node).second) report.warn(pointer, fmt::format("node {} is listed twice and counts once", node));
      if (parent[node] != kNoParent) {
        report.warn(pointer, fmt::format("node {} is not a root: it is a child of node {}, whose transform counts",
                                         node, parent[node]));
      }
    }
  }
}

/// The forest as the checks of skins need it.
struct Forest {
  std::vector<int> parent;
  std::vector<std::size_t> order;  ///< parents first
  std::vector<std::size_t> root;   ///< of each node
};

/// For each node: is `top` the node itself or one of its ancestors?
std::vector<bool> below(std::size_t top, const Forest& forest) {
  std::vector<bool> out(forest.parent.size(), false);
  for (const std::size_t i : forest.order) {
    out[i] = i == top || (forest.parent[i] != kNoParent && out[static_cast<std::size_t>(forest.parent[i])]);
  }
  return out;
}

void check_skin(const Json& document, const Json& skin, const Forest& forest, const std::string& pointer,
                Report& report) {
  const Json& joints = skin["joints"];
  if (joints.empty()) {
    report.error(child(pointer, "joints"), "skin without joints; expected one or more");
    return;
  }
  std::set<std::size_t> seen;
  const std::size_t root = forest.root[joints[0].get<std::size_t>()];
  const std::vector<bool> inside =
      skin.contains("skeleton") ? below(unsigned_or(skin, "skeleton", 0), forest) : std::vector<bool>();
  for (const Json& joint : joints) {
    const auto node = joint.get<std::size_t>();
    if (!seen.insert(node).second) report.warn(child(pointer, "joints"), fmt::format("node {} is listed twice", node));
    if (forest.root[node] != root) report.warn(child(pointer, "joints"), "joints have no common root");
    if (!inside.empty() && !inside[node]) {
      report.warn(child(pointer, "skeleton"), fmt::format("is not an ancestor of joint {}", node));
    }
  }
  if (!skin.contains("inverseBindMatrices")) return;
  const std::uint64_t index = unsigned_or(skin, "inverseBindMatrices", 0);
  const Json& accessor = elements(document, "accessors")[index];
  const std::string at = child(pointer, "inverseBindMatrices");
  if (text_or(accessor, "type", "") != "MAT4" || unsigned_or(accessor, "componentType", 0) != 5126) {
    report.error(at, fmt::format("accessor {} holds other values; expected MAT4 of floats", index));
  } else if (unsigned_or(accessor, "count", 0) < joints.size()) {
    report.error(at, fmt::format("accessor {} holds fewer matrices than the {} joints", index, joints.size()));
  }
}

void check_instancing(const Json& document, const Json& node, const std::string& pointer, Report& report) {
  const auto extensions = node.find("extensions");
  if (extensions == node.end() || !extensions->contains("EXT_mesh_gpu_instancing")) return;
  const std::string at = pointer + "/extensions/EXT_mesh_gpu_instancing/attributes";
  if (!node.contains("mesh")) report.warn(at, "has no meaning on a node without a mesh");
  std::set<std::uint64_t> counts;
  for (const auto& [name, index] : (*extensions)["EXT_mesh_gpu_instancing"]["attributes"].items()) {
    const Json& accessor = elements(document, "accessors")[index.get<std::size_t>()];
    counts.insert(unsigned_or(accessor, "count", 0));
    const std::string type = text_or(accessor, "type", "");
    const std::uint64_t component = unsigned_or(accessor, "componentType", 0);
    const bool integer = accessor.value("normalized", false) && (component == 5120 || component == 5122);
    if (name == "TRANSLATION" || name == "SCALE") {
      if (type != "VEC3" || component != 5126)
        report.error(child(at, name), "accessor holds other values; expected VEC3 of floats");
    } else if (name == "ROTATION") {
      if (type != "VEC4" || !(component == 5126 || integer)) {
        report.error(child(at, name), "accessor holds other values; expected VEC4 of floats or normalized integers");
      }
    } else if (!name.starts_with("_")) {
      report.warn(child(at, name), "unknown instance attribute is ignored; expected TRANSLATION, ROTATION, SCALE");
    }
  }
  if (counts.size() > 1) report.error(at, "accessors have different counts; expected one count");
}

}  // namespace

void check_nodes(const Json& document, Report& report) {
  const Json& nodes = elements(document, "nodes");
  const std::vector<int> parent = parents_of(nodes, report);
  if (report.failed()) return;
  // With one parent each, a node that no root leads to lies on a cycle or below one.
  std::vector<bool> reached(nodes.size(), false);
  for (const std::size_t i : parents_first(nodes, parent)) reached[i] = true;
  const auto lost = std::find(reached.begin(), reached.end(), false);
  if (lost != reached.end()) {
    report.error(child("/nodes", static_cast<std::size_t>(lost - reached.begin())),
                 "is its own ancestor; expected a tree");
  }
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const std::string pointer = child("/nodes", i);
    check_transform(nodes[i], pointer, report);
    check_node_mesh(document, nodes[i], pointer, report);
    check_instancing(document, nodes[i], pointer, report);
  }
  check_scenes(document, parent, report);
}

void check_skins(const Json& document, Report& report) {
  if (report.failed()) return;  // what follows needs a forest
  const Json& nodes = elements(document, "nodes");
  Forest forest;
  forest.parent = parents_of(nodes, report);
  forest.order = parents_first(nodes, forest.parent);
  forest.root.resize(nodes.size());
  for (const std::size_t i : forest.order) {
    forest.root[i] = forest.parent[i] == kNoParent ? i : forest.root[static_cast<std::size_t>(forest.parent[i])];
  }
  const Json& skins = elements(document, "skins");
  std::vector<bool> used(skins.size(), false);
  for (const Json& node : nodes) {
    if (node.contains("skin")) used[unsigned_or(node, "skin", 0)] = true;
  }
  for (std::size_t i = 0; i < skins.size(); ++i) {
    check_skin(document, skins[i], forest, child("/skins", i), report);
    if (!used[i]) report.warn(child("/skins", i), "no node uses it");
  }
}

}  // namespace pf::gltf
