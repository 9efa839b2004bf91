#include "worker/photon/photon_map_bricks.h"

#include <algorithm>
#include <bit>
#include <limits>

#include "common/base/parallel.h"

namespace pf {

MapBricks::MapBricks(std::span<const StoredPhoton> nodes) {
  if (nodes.size() < 2) return;
  const std::size_t count = nodes.size() - 1;
  const auto depth = static_cast<unsigned>(std::bit_width(count));
  std::size_t bricks = 0;
  // The first brick takes what four does not divide: those of the last level, nearly all, are full. Their
  // roots all exist, since no level of the tree but the last is ragged.
  for (unsigned above = 0, height = (depth - 1) % kHeight + 1; above < depth; above += height, height = kHeight) {
    if (!levels_.empty()) height = kHeight;
    levels_.push_back({bricks, std::uint32_t{1} << above, height});
    bricks += std::size_t{1} << above;
  }
  bricks_.resize(bricks);
  boxes_.resize(levels_.back().first);
  std::vector<Box3f> bounds(bricks);
  for (std::size_t level = levels_.size(); level-- > 0;) {
    constexpr std::size_t kGrain = 1024;
    parallel_ranges(levels_[level].root, kGrain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) fill(level, i, nodes, bounds);
    });
  }
  const Vec3f size = bounds.front().size();
  const float edge = std::max({size.x, size.y, size.z});
  area_of_one_ = edge * edge / static_cast<float>(count);
}

void MapBricks::fill(std::size_t level, std::size_t i, std::span<const StoredPhoton> nodes,
                     std::vector<Box3f>& bounds) {
  const Level& at = levels_[level];
  const std::size_t root = at.root + i;
  Brick& brick = bricks_[at.first + i];
  Box3f& box = bounds[at.first + i];
  for (std::size_t lane = 0; lane < kWidth; ++lane) {
    const auto below = static_cast<unsigned>(std::bit_width(lane + 1)) - 1;
    const std::size_t node = (root << below) + (lane + 1 - (std::size_t{1} << below));
    if (below >= at.height || node >= nodes.size()) {
      constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();
      brick.x[lane] = brick.y[lane] = brick.z[lane] = kNowhere;
      brick.normal[lane] = 0;
      continue;
    }
    const StoredPhoton& photon = nodes[node];
    brick.x[lane] = photon.position[0];
    brick.y[lane] = photon.position[1];
    brick.z[lane] = photon.position[2];
    brick.normal[lane] = static_cast<std::uint16_t>(photon.flags >> 2);
    box.extendBy(photon.point());
  }
  if (level + 1 == levels_.size()) return;
  Boxes& boxes = boxes_[at.first + i];
  boxes = {};
  for (std::size_t child = 0; child < std::size_t{1} << at.height; ++child) {
    const Box3f& of_child = bounds[levels_[level + 1].first + (i << at.height) + child];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      boxes.low[axis][child] = of_child.min[static_cast<int>(axis)];
      boxes.high[axis][child] = of_child.max[static_cast<int>(axis)];
    }
    box.extendBy(of_child);
  }
}

}  // namespace pf
