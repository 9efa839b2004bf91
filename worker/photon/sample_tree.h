#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/math/vec.h"
#include "worker/photon/splat_kernel.h"

namespace pf {

/// Samples of the eye in a balanced kd-tree over position and normal direction (five dimensions), for photon rays to walk
/// [Herzog et al. 2007]: a node is left out when its box lies outside the ray's cone or all its normals face away.
///
/// Nodes lie in heap order; the tree splits at the median of its widest dimension, so that node i of a depth holds the i-th
/// equal part of the samples. The nodes of one depth, "branches", are what threads take: each thread adds up the samples of
/// its own branches, ray after ray, so that sums have one order whatever the threads do.
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
    if (!samples_.empty()) descend(0, 0, branch_depth_, ray, [&](std::size_t node) { visit(node - first_of(branch_depth_)); });
  }
  /// Calls visit(index, meeting) for every sample of the branch that the ray meets, ascending.
  template <typename Visit>
  void for_each_in_branch(std::size_t branch, const RayKernel& ray, Visit&& visit) const {
    descend(first_of(branch_depth_) + branch, branch_depth_, leaf_depth_, ray, [&](std::size_t leaf) {
      const std::size_t place = leaf - first_of(leaf_depth_);
      for (std::size_t i = begin_of(place, leaf_depth_); i < begin_of(place + 1, leaf_depth_); ++i) {
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
  struct Node {
    Vec3f centre;
    Vec3f half;                ///< half the box's edges [m]
    float reach = 0;           ///< half the box's diagonal, and the largest least_radius of its samples
    float least_radius = 0;
    Vec3f normal_low, normal_high;
    bool both_sides = false;
  };

  [[nodiscard]] static std::size_t first_of(int depth) { return (std::size_t{1} << depth) - 1; }
  [[nodiscard]] std::size_t begin_of(std::size_t place, int depth) const { return samples_.size() * place >> depth; }
  void build(std::size_t node, int depth, std::size_t place);
  void bound(Node& node, std::span<const SplatSample> samples) const;
  [[nodiscard]] static bool may_meet(const Node& node, const RayKernel& ray);

  /// Calls visit(node) for every node of depth `to` below `node` that the ray may meet.
  template <typename Visit>
  void descend(std::size_t node, int depth, int to, const RayKernel& ray, const Visit& visit) const {
    if (!may_meet(nodes_[node], ray)) return;
    if (depth == to) return visit(node);
    descend(2 * node + 1, depth + 1, to, ray, visit);
    descend(2 * node + 2, depth + 1, to, ray, visit);
  }

  std::vector<SplatSample> samples_;
  std::vector<Node> nodes_;
  int leaf_depth_ = 0;
  int branch_depth_ = 0;
  float normal_scale_ = 1;     ///< metres that a unit of the normal's coordinates is worth when a dimension is chosen
};

}  // namespace pf
