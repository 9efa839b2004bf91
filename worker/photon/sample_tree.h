#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/math/offset.h"
#include "common/math/vec.h"
#include "worker/photon/splat_kernel.h"

namespace pf {

/// Samples of the eye in a balanced kd-tree over position and normal direction (five dimensions), for photon rays to
/// walk [Herzog et al. 2007]: a node is left out when its box lies outside the ray's cone or all its normals face away.
///
/// Nodes lie in heap order; the tree splits at the median of its widest dimension, so that node i of a depth holds the
/// i-th equal part of the samples. The nodes of one depth, "branches", are what threads take: each thread adds up the
/// samples of its own branches, ray after ray, so that sums have one order whatever the threads do.
class SampleTree {
 public:
  SampleTree() = default;
  /// Sorts the samples (in parallel, the same order on any number of threads).
  explicit SampleTree(std::vector<SplatSample> samples);

  /// In the tree's order.
  [[nodiscard]] const std::vector<SplatSample>& samples() const { return samples_; }
  [[nodiscard]] std::size_t branches() const { return samples_.empty() ? 0 : std::size_t{1} << branch_depth_; }

  /// Calls visit(branch) for every branch that the ray's kernel may reach, ascending.
  template <typename Visit>
  void for_each_branch(const RayKernel& ray, Visit&& visit) const {
    if (!samples_.empty())
      descend(0, 0, branch_depth_, ray, [&](std::size_t node) { visit(node - first_of(branch_depth_)); });
  }
  /// Calls visit(index, meeting) for every sample of the branch that the ray meets, ascending.
  template <typename Visit>
  void for_each_in_branch(std::size_t branch, const RayKernel& ray, Visit&& visit) const {
    descend(first_of(branch_depth_) + branch, branch_depth_, leaf_depth_, ray, [&](std::size_t leaf) {
      const std::size_t place = leaf - first_of(leaf_depth_);
      const std::size_t begin = begin_of(place, leaf_depth_);
      for (std::uint32_t near = ray.near(blocks_[place]); near != 0; near &= near - 1) {
        const std::size_t i = begin + static_cast<std::size_t>(std::countr_zero(near));
        if (const auto meeting = ray.meet(samples_[i])) visit(i, *meeting);
      }
    });
  }
  /// The same over the whole tree.
  template <typename Visit>
  void for_each(const RayKernel& ray, Visit&& visit) const {
    for_each_branch(ray, [&](std::size_t branch) { for_each_in_branch(branch, ray, visit); });
  }

 private:
  /// Rounding of the arithmetic in may_meet(), relative to the coordinates.
  static constexpr float kRounding = 4e-6f;

  struct Node {
    Vec3f centre;
    Vec3f half;       ///< half the box's edges [m]
    float reach = 0;  ///< half the box's diagonal, and the largest least_radius of its samples
    float least_radius = 0;
    Vec3f normal_low, normal_high;
    bool both_sides = false;
  };

  [[nodiscard]] static std::size_t first_of(int depth) { return (std::size_t{1} << depth) - 1; }
  [[nodiscard]] std::size_t begin_of(std::size_t place, int depth) const { return samples_.size() * place >> depth; }
  void fill_blocks();
  void build(std::size_t node, int depth, std::size_t place);
  void bound(Node& node, std::span<const SplatSample> samples) const;
  /// Whether the ray may meet a sample of the node: never false where it does.
  [[nodiscard]] static bool may_meet(const Node& node, const RayKernel& ray) {
    const Vec3f& d = ray.direction();
    const Vec3f away = node.centre - ray.origin();
    const float t = dot(away, d);
    const float rounding = kRounding * (std::abs(t) + node.reach + max_magnitude(ray.origin()));
    float near = ray.t_begin(node.least_radius) - rounding;
    float far = ray.t_end(node.least_radius) + rounding;
    if (t + node.reach < near || t - node.reach > far) return false;
    const float radius =
        std::max(ray.radius(t - node.reach), ray.radius(t + node.reach)) + node.least_radius + rounding;
    const float bound = node.reach + radius;
    if (length2(away - d * t) > bound * bound) return false;
    // The normal that faces the ray most, of all in the box of normals.
    if (!node.both_sides) {
      const float facing = std::min(d.x * node.normal_low.x, d.x * node.normal_high.x) +
                           std::min(d.y * node.normal_low.y, d.y * node.normal_high.y) +
                           std::min(d.z * node.normal_low.z, d.z * node.normal_high.z);
      if (facing > kRounding) return false;
    }
    // The widened box against the ray, an axis at a time [Kay and Kajiya 1986].
    for (int k = 0; k < 3; ++k) {
      const float inverse = ray.inverse_direction()[k];
      const float middle = away[k] * inverse;
      const float spread = (node.half[k] + radius) * std::abs(inverse) + kRounding * std::abs(middle);
      near = std::max(near, middle - spread);
      far = std::min(far, middle + spread);
    }
    return near <= far;
  }

  /// Calls visit(node) for every node of depth `to` below `node` that the ray may meet.
  template <typename Visit>
  void descend(std::size_t node, int depth, int to, const RayKernel& ray, const Visit& visit) const {
    if (!may_meet(nodes_[node], ray)) return;
    if (depth == to) return visit(node);
    descend(2 * node + 1, depth + 1, to, ray, visit);
    descend(2 * node + 2, depth + 1, to, ray, visit);
  }

  std::vector<SplatSample> samples_;
  std::vector<SampleBlock> blocks_;  ///< of the leaves, in order
  std::vector<Node> nodes_;
  int leaf_depth_ = 0;
  int branch_depth_ = 0;
  float normal_scale_ = 1;  ///< metres that a unit of the normal's coordinates is worth when a dimension is chosen
};

}  // namespace pf
