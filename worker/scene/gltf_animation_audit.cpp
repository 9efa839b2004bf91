// Animations are not played; this only names what is wrong with them.

#include <cmath>
#include <set>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "worker/scene/gltf_audit.h"
#include "worker/scene/gltf_validation.h"

namespace pf::gltf {
namespace {

class AnimationAuditor {
 public:
  AnimationAuditor(const Model& model, AccessorReader& accessors, Report& report)
      : model_(model), accessors_(accessors), report_(report) {}

  void run(const Json& animation, const std::string& pointer);

 private:
  void sampler_input(const Json& sampler, const std::string& pointer);
  void channel(const Json& animation, const Json& channel, const std::string& parent, std::size_t number);
  void output(const Json& sampler, const std::string& path, std::size_t node, const std::string& at);
  void quaternions(int accessor, const std::string& interpolation, const std::string& pointer);
  [[nodiscard]] bool strided(int accessor) const;
  [[nodiscard]] bool is_accessor(const Json& sampler, const char* key) const {
    return sampler.contains(key) && unsigned_or(sampler, key, 0) < model_.gltf.accessors.size();
  }

  const Model& model_;
  AccessorReader& accessors_;
  Report& report_;
};

bool AnimationAuditor::strided(int accessor) const {
  const int view = accessors_.accessor(accessor).bufferView;
  return view >= 0 && model_.gltf.bufferViews[static_cast<std::size_t>(view)].byteStride > 0;
}

void AnimationAuditor::sampler_input(const Json& sampler, const std::string& pointer) {
  const int index = sampler["input"].get<int>();
  const tinygltf::Accessor& a = accessors_.accessor(index);
  const std::string at = child(pointer, "input");
  if (strided(index)) report_.warn(at, "buffer view has a byteStride");
  if (a.type != TINYGLTF_TYPE_SCALAR || a.componentType != TINYGLTF_COMPONENT_TYPE_FLOAT) {
    report_.warn(at, "accessor holds other values; expected SCALAR of floats");
    return;
  }
  if (a.minValues.empty() || a.maxValues.empty()) report_.warn(at, "accessor has no min and max");
  if (text_or(sampler, "interpolation", "LINEAR") == "CUBICSPLINE" && a.count < 2)
    report_.warn(at, "CUBICSPLINE needs two times or more");
  if (a.bufferView < 0 || !accessors_.has_data(index)) return;
  const auto times = accessors_.raw(index, at);
  if (!times) return;
  for (std::size_t i = 0; i < times->size(); ++i) {
    if ((*times)[i] < 0) report_.warn(at, "has negative times");
    if (i > 0 && !((*times)[i] > (*times)[i - 1])) report_.warn(at, "has times that do not increase");
  }
}

void AnimationAuditor::quaternions(int accessor, const std::string& interpolation, const std::string& pointer) {
  const auto values = accessors_.raw(accessor, pointer);
  if (!values || accessors_.accessor(accessor).bufferView < 0) return;  // nothing to look at
  const tinygltf::Accessor& a = accessors_.accessor(accessor);
  const double scale =
      a.componentType == TINYGLTF_COMPONENT_TYPE_FLOAT ? 1.0
      : a.componentType == TINYGLTF_COMPONENT_TYPE_BYTE || a.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE
          ? 127.0
          : 32767.0;
  const bool cubic = interpolation == "CUBICSPLINE";
  for (std::size_t q = 0; 4 * q + 3 < values->size(); ++q) {
    if (cubic && q % 3 != 1) continue;  // tangents have any length
    double length2 = 0;
    for (std::size_t c = 0; c < 4; ++c) length2 += (*values)[4 * q + c] * (*values)[4 * q + c] / (scale * scale);
    if (std::abs(std::sqrt(length2) - 1.0) > 0.02) {
      report_.warn(pointer, fmt::format("quaternion {} is not of unit length", q));
      return;
    }
  }
}

void AnimationAuditor::output(const Json& sampler, const std::string& path, std::size_t node, const std::string& at) {
  const int index = sampler["output"].get<int>();
  const tinygltf::Accessor& a = accessors_.accessor(index);
  if (strided(index)) report_.warn(at, "buffer view has a byteStride");
  const int expected = path == "rotation"  ? TINYGLTF_TYPE_VEC4
                       : path == "weights" ? TINYGLTF_TYPE_SCALAR
                                           : TINYGLTF_TYPE_VEC3;
  const bool float_only = path == "translation" || path == "scale";
  const bool integer = a.normalized && a.componentType != TINYGLTF_COMPONENT_TYPE_FLOAT &&
                       a.componentType != TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
  if (a.type != expected || !(a.componentType == TINYGLTF_COMPONENT_TYPE_FLOAT || (integer && !float_only))) {
    report_.warn(at, fmt::format("accessor holds other values than {} needs", path));
    return;
  }
  std::size_t each = text_or(sampler, "interpolation", "LINEAR") == "CUBICSPLINE" ? 3 : 1;
  if (path == "weights") {
    const int mesh = node < model_.gltf.nodes.size() ? model_.gltf.nodes[node].mesh : -1;
    if (mesh < 0 || model_.gltf.meshes[static_cast<std::size_t>(mesh)].primitives.empty()) return;
    each *= model_.gltf.meshes[static_cast<std::size_t>(mesh)].primitives[0].targets.size();
  }
  if (is_accessor(sampler, "input")) {
    const std::size_t count = accessors_.count(sampler["input"].get<int>()) * each;
    if (a.count != count) report_.warn(at, fmt::format("has {} values; expected {}", a.count, count));
  }
  if (path == "rotation") quaternions(index, text_or(sampler, "interpolation", "LINEAR"), at);
}

void AnimationAuditor::channel(const Json& animation, const Json& channel, const std::string& parent,
                               std::size_t number) {
  const std::string pointer = fmt::format("{}/channels/{}", parent, number);
  if (!channel.contains("sampler") || !channel.contains("target")) return;
  const Json& samplers = elements(animation, "samplers");
  const std::uint64_t index = unsigned_or(channel, "sampler", 0);
  if (index >= samplers.size()) {
    report_.warn(child(pointer, "sampler"),
                 fmt::format("is {}; the animation has {} samplers", index, samplers.size()));
    return;
  }
  const Json& target = channel["target"];
  const std::string path = text_or(target, "path", "");
  if (path != "translation" && path != "rotation" && path != "scale" && path != "weights") {
    report_.warn(pointer + "/target/path",
                 fmt::format("is {}; expected translation, rotation, scale or weights", in_quotes(path)));
    return;
  }
  const std::uint64_t node_index = unsigned_or(target, "node", model_.gltf.nodes.size());
  if (node_index < model_.gltf.nodes.size()) {
    const tinygltf::Node& node = model_.gltf.nodes[node_index];
    if (path == "weights") {
      const bool morphs = node.mesh >= 0 &&
                          !model_.gltf.meshes[static_cast<std::size_t>(node.mesh)].primitives.empty() &&
                          !model_.gltf.meshes[static_cast<std::size_t>(node.mesh)].primitives[0].targets.empty();
      if (!morphs) report_.warn(pointer + "/target", fmt::format("node {} has no morph targets", node_index));
    } else if (!node.matrix.empty()) {
      report_.warn(pointer + "/target", fmt::format("node {} has a matrix, which cannot be animated", node_index));
    }
  }
  if (is_accessor(samplers[index], "output"))
    output(samplers[index], path, node_index, fmt::format("{}/samplers/{}/output", parent, index));
}

void AnimationAuditor::run(const Json& animation, const std::string& pointer) {
  const Json& samplers = elements(animation, "samplers");
  for (std::size_t i = 0; i < samplers.size(); ++i) {
    if (is_accessor(samplers[i], "input")) sampler_input(samplers[i], fmt::format("{}/samplers/{}", pointer, i));
  }
  std::set<std::pair<std::uint64_t, std::string>> targets;
  const Json& channels = elements(animation, "channels");
  for (std::size_t i = 0; i < channels.size(); ++i) {
    const std::string at = fmt::format("{}/channels/{}", pointer, i);
    channel(animation, channels[i], pointer, i);
    if (!channels[i].contains("target") || !channels[i]["target"].contains("node")) continue;
    const Json& target = channels[i]["target"];
    if (!targets.emplace(unsigned_or(target, "node", 0), text_or(target, "path", "")).second) {
      report_.warn(at, "moves what another channel moves already");
    }
  }
}

}  // namespace

void audit_animations(const Model& model, AccessorReader& accessors, Report& report) {
  AnimationAuditor auditor(model, accessors, report);
  for (std::size_t i = 0; i < model.animations.size(); ++i) auditor.run(model.animations[i], child("/animations", i));
}

}  // namespace pf::gltf
