#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/math/sampling.h"
#include "common/math/vec.h"

namespace pf {

/// Where light is wanted: a point, and the normal that bounds the directions it may come from.
struct Receiver {
  Vec3f p;
  Vec3f n;
  bool transmissive = false;  ///< light from both sides of the normal counts
};

/// Bounds of the light that one emitter or a group sends out: from `box`, into directions within theta_o +
/// theta_e of `axis`, theta_o bounding the normals and theta_e the spread around them [Conty Estevez and
/// Kulla 2018, section 4.1].
struct LightBounds {
  Box3f box;
  Vec3f axis{0.0f, 0.0f, 1.0f};
  float cos_o = 1.0f;
  float cos_e = 0.0f;
  float energy = 0.0f;  ///< largest radiant intensity, mean of the channels [W/sr]; sums over a group
  bool two_sided = false;
};

[[nodiscard]] LightBounds unite(const LightBounds& a, const LightBounds& b);

/// A binary tree over emitters that picks one for a receiver with a probability close to its contribution, in
/// the time of one descent [Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive
/// Tree Splitting", without the splitting; pbrt-v4 12.6.3]. Immutable; the same input gives the same tree.
class LightTree {
 public:
  LightTree() = default;
  explicit LightTree(std::span<const LightBounds> lights);

  struct Pick {
    std::uint32_t light = 0;
    float probability = 0;
    float u = 0;  ///< what is left of the random number
  };

  /// Picks an emitter; empty where none can contribute. `exact(light)`, in [0, 1], sharpens what the bounds
  /// of one single emitter say; it is 0 exactly where that emitter sends no light towards the receiver.
  template <typename Exact>
  [[nodiscard]] std::optional<Pick> sample(const Receiver& receiver, float u, const Exact& exact) const;
  /// Probability with which sample() returns `light`.
  template <typename Exact>
  [[nodiscard]] float probability(const Receiver& receiver, std::uint32_t light, const Exact& exact) const;
  /// Estimated irradiance at the receiver from all emitters; 0 only if none can contribute.
  template <typename Exact>
  [[nodiscard]] float importance(const Receiver& receiver, const Exact& exact) const;
  [[nodiscard]] bool empty() const { return nodes_.empty(); }

 private:
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  struct Node {
    Vec3f center{0, 0, 0};  ///< sphere around the box
    float radius2 = 0;
    Vec3f axis{0, 0, 1};
    float cos_o = 1, sin_o = 0, cos_e = 0;
    float energy = 0;
    std::uint32_t right = 0;  ///< the left child follows its parent
    std::uint32_t parent = kNone;
    std::uint32_t light = kNone;  ///< of a leaf
    bool two_sided = false;
  };
  struct Item;

  std::uint32_t build(std::span<Item> items, int depth, std::uint32_t parent);
  [[nodiscard]] static std::size_t split(std::span<Item> items, const LightBounds& bounds, int depth);
  [[nodiscard]] static float node_importance(const Node& node, const Receiver& receiver);
  /// Probability of the left child. Neither side that can contribute falls below a floor: the estimates are
  /// rough.
  [[nodiscard]] static float left_share(float a, float b) {
    constexpr float kFloor = 1e-4f;
    const float share = a / (a + b);
    return a > 0.0f && b > 0.0f ? std::clamp(share, kFloor, 1.0f - kFloor) : share;
  }
  template <typename Exact>
  [[nodiscard]] static float importance_of(const Node& node, const Receiver& receiver, const Exact& exact) {
    const float estimate = node_importance(node, receiver);
    return node.light == kNone || estimate <= 0.0f ? estimate : estimate * exact(node.light);
  }

  std::vector<Node> nodes_;
  std::vector<std::uint32_t> leaf_;  ///< node of light i
};

template <typename Exact>
std::optional<LightTree::Pick> LightTree::sample(const Receiver& receiver, float u, const Exact& exact) const {
  if (nodes_.empty() || !(importance_of(nodes_[0], receiver, exact) > 0.0f)) return std::nullopt;
  std::uint32_t index = 0;
  float chosen = 1.0f;
  while (nodes_[index].light == kNone) {
    const std::uint32_t left = index + 1, right = nodes_[index].right;
    const float a = importance_of(nodes_[left], receiver, exact);
    const float b = importance_of(nodes_[right], receiver, exact);
    if (!(a + b > 0.0f)) return std::nullopt;
    const float share = left_share(a, b);
    if (u < share) {
      u = std::min(u / share, kOneMinusEpsilon);
      chosen *= share;
      index = left;
    } else {
      u = std::clamp((u - share) / (1.0f - share), 0.0f, kOneMinusEpsilon);
      chosen *= 1.0f - share;
      index = right;
    }
  }
  return Pick{nodes_[index].light, chosen, u};
}

template <typename Exact>
float LightTree::probability(const Receiver& receiver, std::uint32_t light, const Exact& exact) const {
  if (nodes_.empty() || !(importance_of(nodes_[0], receiver, exact) > 0.0f)) return 0.0f;
  float chosen = 1.0f;
  for (std::uint32_t index = leaf_[light]; nodes_[index].parent != kNone; index = nodes_[index].parent) {
    const std::uint32_t left = nodes_[index].parent + 1, right = nodes_[nodes_[index].parent].right;
    const float a = importance_of(nodes_[left], receiver, exact);
    const float b = importance_of(nodes_[right], receiver, exact);
    if (!(a + b > 0.0f)) return 0.0f;
    const float share = left_share(a, b);
    chosen *= index == left ? share : 1.0f - share;
  }
  return chosen;
}

template <typename Exact>
float LightTree::importance(const Receiver& receiver, const Exact& exact) const {
  return nodes_.empty() ? 0.0f : importance_of(nodes_[0], receiver, exact);
}

}  // namespace pf
