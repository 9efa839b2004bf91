#include "worker/scene/gltf_audit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include <fmt/format.h>

namespace pf::gltf {
namespace {

/// Bounds are written in decimal, often with six digits.
constexpr double kBoundTolerance = 1e-5;

bool differs(double a, double b) {
  return std::abs(a - b) > kBoundTolerance * std::max({1.0, std::abs(a), std::abs(b)});
}

void audit_accessor(int index, AccessorReader& accessors, Report& report) {
  const tinygltf::Accessor& a = accessors.accessor(index);
  const bool bounded = !a.minValues.empty() || !a.maxValues.empty();
  if (!accessors.has_data(index)) return;  // make_model has warned
  if ((a.bufferView < 0 && !a.sparse.isSparse) || (a.componentType != TINYGLTF_COMPONENT_TYPE_FLOAT && !bounded))
    return;
  const std::string pointer = child("/accessors", static_cast<std::size_t>(index));
  const auto values = accessors.raw(index, pointer);
  if (!values) {
    report.warn(values.error(), "");
    return;
  }
  const std::size_t n = accessors.components(index);
  std::vector<double> low(n, std::numeric_limits<double>::infinity());
  std::vector<double> high(n, -std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < values->size(); ++i) {
    const double v = (*values)[i];
    if (!std::isfinite(v)) {
      report.warn(pointer, fmt::format("value {} is not finite", i / n));
      return;
    }
    low[i % n] = std::min(low[i % n], v);
    high[i % n] = std::max(high[i % n], v);
  }
  for (std::size_t c = 0; c < n; ++c) {
    if (a.minValues.size() == n && differs(a.minValues[c], low[c])) {
      report.warn(child(pointer, "min"), fmt::format("says {}, the least value is {}", a.minValues[c], low[c]));
      break;
    }
    if (a.maxValues.size() == n && differs(a.maxValues[c], high[c])) {
      report.warn(child(pointer, "max"), fmt::format("says {}, the largest value is {}", a.maxValues[c], high[c]));
      break;
    }
  }
}

/// Joints and weights of one vertex, of every set.
struct VertexInfluences {
  std::vector<std::pair<double, double>> joint_weight;
};

void audit_vertex(const VertexInfluences& vertex, std::size_t joints, std::size_t i, const std::string& pointer,
                  Report& report) {
  std::set<double> seen;
  double sum = 0;
  for (const auto& [joint, weight] : vertex.joint_weight) {
    sum += weight;
    if (weight < 0) report.warn(pointer, "has negative joint weights");
    if (weight == 0) continue;
    if (joint >= static_cast<double>(joints))
      report.warn(pointer, fmt::format("vertex {} names joint {}, which its skin has not", i, joint));
    if (!seen.insert(joint).second) report.warn(pointer, fmt::format("vertex {} names joint {} twice", i, joint));
  }
  if (std::abs(sum - 1.0) > 0.02) report.warn(pointer, "has joint weights that do not sum to 1");
}

void audit_influences(const tinygltf::Primitive& primitive, std::size_t joint_count, AccessorReader& accessors,
                      const std::string& pointer, Report& report) {
  std::vector<VertexInfluences> vertices;
  for (int set = 0;; ++set) {
    const auto joints = primitive.attributes.find(fmt::format("JOINTS_{}", set));
    const auto weights = primitive.attributes.find(fmt::format("WEIGHTS_{}", set));
    if (joints == primitive.attributes.end() || weights == primitive.attributes.end()) break;
    for (const int a : {joints->second, weights->second}) {
      if (!accessors.has_data(a)) return;
      if (accessors.accessor(a).bufferView < 0 && !accessors.accessor(a).sparse.isSparse)
        return;  // compressed, or nothing
    }
    const auto j = accessors.raw(joints->second, pointer);
    const auto w = accessors.raw(weights->second, pointer);
    if (!j || !w || j->size() != w->size() || accessors.components(joints->second) != 4) return;
    const tinygltf::Accessor& wa = accessors.accessor(weights->second);
    const double scale = wa.componentType == TINYGLTF_COMPONENT_TYPE_FLOAT           ? 1.0
                         : wa.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE ? 255.0
                                                                                     : 65535.0;
    vertices.resize(j->size() / 4);
    for (std::size_t k = 0; k < j->size(); ++k) vertices[k / 4].joint_weight.emplace_back((*j)[k], (*w)[k] / scale);
  }
  for (std::size_t i = 0; i < vertices.size(); ++i) audit_vertex(vertices[i], joint_count, i, pointer, report);
}

/// TANGENT is read only for normal maps; here it is looked at in any case.
void audit_tangents(const tinygltf::Primitive& primitive, AccessorReader& accessors, const std::string& pointer,
                    Report& report) {
  const auto it = primitive.attributes.find("TANGENT");
  if (it == primitive.attributes.end() || !accessors.has_data(it->second)) return;
  const tinygltf::Accessor& a = accessors.accessor(it->second);
  if (a.bufferView < 0 || a.componentType != TINYGLTF_COMPONENT_TYPE_FLOAT || accessors.components(it->second) != 4)
    return;
  const auto values = accessors.raw(it->second, pointer);
  if (!values) return;
  for (std::size_t i = 0; i + 3 < values->size(); i += 4) {
    const double* t = values->data() + i;
    const bool unit = std::abs(std::sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) - 1.0) < 0.02;
    if (!unit || std::abs(t[3]) != 1.0) {
      report.warn(pointer, "has tangents that are not of unit length with a w of 1 or -1; they are normalised");
      return;
    }
  }
}

void audit_bind_matrices(const tinygltf::Skin& skin, std::size_t index, AccessorReader& accessors, Report& report) {
  if (skin.inverseBindMatrices < 0 || !accessors.has_data(skin.inverseBindMatrices)) return;
  if (accessors.accessor(skin.inverseBindMatrices).bufferView < 0) return;
  const std::string pointer = fmt::format("/skins/{}/inverseBindMatrices", index);
  const auto values = accessors.raw(skin.inverseBindMatrices, pointer);
  if (!values || accessors.components(skin.inverseBindMatrices) != 16) return;
  for (std::size_t m = 0; m + 16 <= values->size(); m += 16) {
    const double* v = values->data() + m;
    if (differs(v[3], 0) || differs(v[7], 0) || differs(v[11], 0) || differs(v[15], 1)) {
      report.warn(pointer, fmt::format("matrix {} is not affine; its last row is taken as 0, 0, 0, 1", m / 16));
    }
  }
}

}  // namespace

void audit_accessors(const Model& model, AccessorReader& accessors, Report& report) {
  for (std::size_t i = 0; i < model.gltf.accessors.size(); ++i) audit_accessor(static_cast<int>(i), accessors, report);
}

void audit_skins(const Model& model, AccessorReader& accessors, Report& report) {
  for (std::size_t i = 0; i < model.gltf.skins.size(); ++i)
    audit_bind_matrices(model.gltf.skins[i], i, accessors, report);
  // Each mesh once, with the skin of the first node that gives it one.
  std::vector<int> skin_of(model.gltf.meshes.size(), -1);
  for (const tinygltf::Node& node : model.gltf.nodes) {
    if (node.mesh >= 0 && node.skin >= 0 && skin_of[static_cast<std::size_t>(node.mesh)] < 0) {
      skin_of[static_cast<std::size_t>(node.mesh)] = node.skin;
    }
  }
  for (std::size_t m = 0; m < model.gltf.meshes.size(); ++m) {
    const std::size_t joints = skin_of[m] < 0 ? std::numeric_limits<std::size_t>::max()
                                              : model.gltf.skins[static_cast<std::size_t>(skin_of[m])].joints.size();
    for (std::size_t p = 0; p < model.gltf.meshes[m].primitives.size(); ++p) {
      const std::string pointer = fmt::format("/meshes/{}/primitives/{}", m, p);
      audit_influences(model.gltf.meshes[m].primitives[p], joints, accessors, pointer, report);
      audit_tangents(model.gltf.meshes[m].primitives[p], accessors, pointer, report);
    }
  }
}

void audit(const Model& model, AccessorReader& accessors, Report& report) {
  audit_accessors(model, accessors, report);
  audit_skins(model, accessors, report);
  audit_animations(model, accessors, report);
}

}  // namespace pf::gltf
