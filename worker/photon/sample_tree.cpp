#include "worker/photon/sample_tree.h"

#include <algorithm>
#include <array>

#include "common/base/parallel.h"
#include "common/math/offset.h"

namespace pf {
namespace {

/// Leaves hold up to one sample more than this where the number is no multiple.
constexpr std::size_t kLeafSamples = SampleBlock::kWidth - 1;
constexpr int kBranchDepth = 8;
/// Samples below which a subtree is built by one thread.
constexpr std::size_t kParallelSamples = 8192;
/// Part of the scene's size that the whole sphere of normals is worth: a split by normal then comes after a few by
/// position.
constexpr float kNormalShare = 0.1f;

/// Octahedral coordinates of a unit vector: the two dimensions of direction.
Vec2f octahedral(const Vec3f& n) {
  const float scale = 1.0f / (std::abs(n.x) + std::abs(n.y) + std::abs(n.z));
  const float u = n.x * scale;
  const float v = n.y * scale;
  if (n.z >= 0.0f) return {u, v};
  return {(1.0f - std::abs(v)) * std::copysign(1.0f, u), (1.0f - std::abs(u)) * std::copysign(1.0f, v)};
}

float coordinate(const SplatSample& s, int dimension) {
  if (dimension < 3) return s.position[dimension];
  const Vec2f direction = octahedral(s.ng);
  return dimension == 3 ? direction.x : direction.y;
}

}  // namespace

SampleTree::SampleTree(std::vector<SplatSample> samples) : samples_(std::move(samples)) {
  if (samples_.empty()) return;
  while ((samples_.size() >> leaf_depth_) > kLeafSamples) ++leaf_depth_;
  branch_depth_ = std::min(leaf_depth_, kBranchDepth);
  nodes_.resize(first_of(leaf_depth_ + 1));
  Box3f box;
  for (const SplatSample& s : samples_) box.extendBy(s.position);
  normal_scale_ = kNormalShare * length(box.size());
  build(0, 0, 0);
  fill_blocks();
}

void SampleTree::fill_blocks() {
  blocks_.resize(std::size_t{1} << leaf_depth_);
  parallel_ranges(blocks_.size(), 256, [&](std::size_t first, std::size_t last) {
    for (std::size_t place = first; place < last; ++place) {
      SampleBlock& block = blocks_[place];
      for (auto* field : {&block.x, &block.y, &block.z}) field->fill(kInfinity);
      block.least_radius.fill(0.0f);
      const std::size_t begin = begin_of(place, leaf_depth_);
      for (std::size_t i = begin; i < begin_of(place + 1, leaf_depth_); ++i) {
        const SplatSample& s = samples_[i];
        block.x[i - begin] = s.position.x;
        block.y[i - begin] = s.position.y;
        block.z[i - begin] = s.position.z;
        block.least_radius[i - begin] = s.least_radius;
      }
    }
  });
}

void SampleTree::build(std::size_t node, int depth, std::size_t place) {
  const std::size_t begin = begin_of(place, depth);
  const std::size_t end = begin_of(place + 1, depth);
  const std::span<SplatSample> range(samples_.data() + begin, end - begin);
  if (depth == leaf_depth_) return bound(nodes_[node], range);
  std::array<float, 5> low, high;
  low.fill(kInfinity), high.fill(-kInfinity);
  for (const SplatSample& s : range) {
    for (int k = 0; k < 5; ++k) {
      const auto i = static_cast<std::size_t>(k);
      low[i] = std::min(low[i], coordinate(s, k));
      high[i] = std::max(high[i], coordinate(s, k));
    }
  }
  int widest = 0;
  float width = -1.0f;
  for (int k = 0; k < 5; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const float w = (high[i] - low[i]) * (k < 3 ? 1.0f : normal_scale_);
    if (w > width) widest = k, width = w;
  }
  const std::size_t middle = begin_of(2 * place + 1, depth + 1) - begin;
  // Equal coordinates are told apart by the caller's numbers: one order of samples.
  std::nth_element(range.begin(), range.begin() + static_cast<std::ptrdiff_t>(middle), range.end(),
                   [&](const SplatSample& a, const SplatSample& b) {
                     const float ka = coordinate(a, widest);
                     const float kb = coordinate(b, widest);
                     return ka < kb || (ka == kb && a.id < b.id);
                   });
  const auto lower = [&] { build(2 * node + 1, depth + 1, 2 * place); };
  const auto upper = [&] { build(2 * node + 2, depth + 1, 2 * place + 1); };
  if (range.size() >= kParallelSamples) {
    parallel_invoke(lower, upper);
  } else {
    lower(), upper();
  }
  bound(nodes_[node], range);
}

void SampleTree::bound(Node& node, std::span<const SplatSample> samples) const {
  Box3f box;
  Box3f normals;
  for (const SplatSample& s : samples) {
    box.extendBy(s.position);
    normals.extendBy(s.ng);
    node.least_radius = std::max(node.least_radius, s.least_radius);
    node.both_sides = node.both_sides || s.both_sides;
  }
  if (samples.empty()) return;
  const float margin = kRounding * std::max(max_magnitude(box.min), max_magnitude(box.max));
  node.centre = box.center();
  node.half = 0.5f * box.size() + Vec3f(margin, margin, margin);
  node.reach = length(node.half);
  node.normal_low = normals.min;
  node.normal_high = normals.max;
}

}  // namespace pf
