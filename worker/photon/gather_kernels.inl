// Query code over a vector type V of 16 floats; included by one source per instruction set. Every operation is
// elementwise and correctly rounded, and sums are integers: all instruction sets give the same bits.

#include <array>
#include <bit>
#include <utility>

#include "worker/photon/photon_tree.h"

namespace pf {
namespace {

template <typename V>
struct QueryLanes {
  typename V::Float px, py, pz, nx, ny, nz, radius2, plane, cosine;
  const DiscQuery& query;
  std::uint32_t seen_normal = PhotonTree::kMixedNormals;  ///< of the last block, and whether its photons face the query
  bool faces = false;

  explicit QueryLanes(const DiscQuery& q)
      : px(V::set(q.position.x)),
        py(V::set(q.position.y)),
        pz(V::set(q.position.z)),
        nx(V::set(q.normal.x)),
        ny(V::set(q.normal.y)),
        nz(V::set(q.normal.z)),
        radius2(V::set(q.radius2)),
        plane(V::set(kPlaneTolerance * std::sqrt(q.radius2))),
        cosine(V::set(kMinNormalCosine * kNormalSteps)),
        query(q) {}

  /// Bit i: box i of the node meets the ball.
  [[nodiscard]] std::uint32_t boxes(const PhotonTree::Node& node) const {
    const auto axis = [&](std::size_t a, const typename V::Float& p) {
      const auto nearest = V::max(V::min(p, V::load(node.upper[a].data())), V::load(node.lower[a].data()));
      const auto d = V::sub(nearest, p);
      return V::mul(d, d);
    };
    return V::bits(V::less_equal(V::add(V::add(axis(0, px), axis(1, py)), axis(2, pz)), radius2));
  }

  /// The test of normals for a block in which all are the same: the same operations as in vectors, once.
  [[nodiscard]] bool block_faces(std::uint32_t packed) {
    if (packed == seen_normal) return faces;
    seen_normal = packed;
    const auto byte = [&](int i) { return static_cast<float>(static_cast<std::int8_t>(packed >> (8 * i))); };
    const Vec3f& n = query.normal;
    const float facing = byte(0) * n.x + byte(1) * n.y + byte(2) * n.z;
    return faces = kMinNormalCosine * kNormalSteps <= (query.both_sides ? std::abs(facing) : facing);
  }

  /// Mask of the accepted photons of a block.
  [[nodiscard]] typename V::Mask photons(const PhotonTree& tree, std::size_t index) {
    const std::uint32_t packed = tree.block_normal(index);
    if (packed != PhotonTree::kMixedNormals && !block_faces(packed)) return V::none();
    const PhotonTree::Block& p = tree.blocks()[index];
    const auto dx = V::sub(V::load(p.x.data()), px);
    const auto dy = V::sub(V::load(p.y.data()), py);
    const auto dz = V::sub(V::load(p.z.data()), pz);
    const auto d2 = V::add(V::add(V::mul(dx, dx), V::mul(dy, dy)), V::mul(dz, dz));
    const auto height = V::add(V::add(V::mul(dx, nx), V::mul(dy, ny)), V::mul(dz, nz));
    const auto mask = V::both(V::less_equal(d2, radius2), V::less_equal(V::abs(height), plane));
    if (packed != PhotonTree::kMixedNormals) return mask;
    const auto normal = V::load_bits(p.normal.data());
    auto facing = V::add(V::add(V::mul(V::signed_byte(normal, 0), nx), V::mul(V::signed_byte(normal, 1), ny)),
                         V::mul(V::signed_byte(normal, 2), nz));
    if (query.both_sides) facing = V::abs(facing);
    return V::both(mask, V::less_equal(cosine, facing));
  }
};

/// Blocks that a query of ordinary size may meet.
constexpr std::size_t kMostListed = 512;
/// Room for what is appended past the end before it is counted.
using BlockList = std::array<std::uint32_t, kMostListed + 3 * PhotonTree::kWidth>;

/// Lists all blocks whose box meets the ball, in ascending order, and returns their number; or more than kMostListed
/// when they are too many. Level by level, two nodes at a time and without a branch on what they hold: a query of some
/// ten blocks would spend more on branches that go the unexpected way than on its arithmetic.
template <typename V>
std::size_t list_blocks(const PhotonTree& tree, const QueryLanes<V>& lanes, BlockList& list) {
  constexpr auto kWidth = static_cast<std::uint32_t>(PhotonTree::kWidth);
  BlockList other;
  std::uint32_t* from = tree.levels().size() % 2 == 0 ? list.data() : other.data();
  std::uint32_t* to = tree.levels().size() % 2 == 0 ? other.data() : list.data();
  std::size_t count = 1;
  from[0] = 0;
  for (std::size_t level = tree.levels().size(); level-- > 0;) {
    const PhotonTree::Node* nodes = tree.levels()[level].data();
    from[count] = 0;  // a partner for the last of an odd number; what it meets is dropped
    std::size_t found = 0;
    for (std::size_t i = 0; i < count; i += 2) {
      const std::uint32_t first = from[i], second = from[i + 1];
      const std::uint32_t met_first = lanes.boxes(nodes[first]);
      const std::uint32_t met_second = lanes.boxes(nodes[second]) & (i + 1 < count ? 0xFFFFu : 0u);
      V::append(to + found, met_first, first * kWidth);
      found += static_cast<std::size_t>(std::popcount(met_first));
      V::append(to + found, met_second, second * kWidth);
      found += static_cast<std::size_t>(std::popcount(met_second));
      if (found > kMostListed) return found;
    }
    std::swap(from, to);
    count = found;
  }
  return count;
}

/// Calls visit(index) for every block whose box meets the ball, in ascending order; for balls that hold many blocks.
template <typename V, typename Visit>
void walk_blocks(const PhotonTree& tree, const QueryLanes<V>& lanes, Visit&& visit) {
  constexpr std::size_t kWidth = PhotonTree::kWidth;
  // 16^9 is more than 32 bits can index.
  constexpr std::size_t kMaxLevels = 9;
  const auto& levels = tree.levels();
  std::uint32_t pending[kMaxLevels];  // boxes of the level's current node yet to be entered
  std::size_t first[kMaxLevels];      // index of that node's first box
  std::size_t depth = levels.size() - 1;
  std::size_t node = 0;
  while (true) {
    std::uint32_t met = lanes.boxes(levels[depth][node]);
    if (depth > 0) {
      pending[depth] = met;
      first[depth] = node * kWidth;
    } else {
      for (; met != 0; met &= met - 1) visit(node * kWidth + static_cast<std::size_t>(std::countr_zero(met)));
      ++depth;
    }
    while (depth < levels.size() && pending[depth] == 0) ++depth;
    if (depth >= levels.size()) return;
    node = first[depth] + static_cast<std::size_t>(std::countr_zero(pending[depth]));
    pending[depth] &= pending[depth] - 1;
    --depth;
  }
}

/// A list for several queries reaches so many times as far as the first of them: a wider one serves more of them and
/// holds more boxes for each to test.
constexpr float kReachOfRadii = 2.25f;
/// Sums of a distance and a radius round; boxes at the very edge of the list must not be missed.
constexpr float kReachMargin = 0.9999f;
constexpr int kQueriesToSkip = 16;

/// Whether all blocks that the query can meet are in the list.
inline bool reaches(const NearbyBlocks& nearby, const DiscQuery& query, float radius) {
  return length(query.position - nearby.centre) + radius <= kReachMargin * nearby.reach;
}

/// Where the next queries will be looked for: ahead, as far as still leaves this one in reach, if it is a small step
/// from the last.
inline Vec3f centre_ahead(const NearbyBlocks& nearby, const DiscQuery& query, float radius) {
  constexpr float kSmallStep = 2.0f;  // times what was reached
  constexpr float kInReach = 0.9f;
  const Vec3f step = query.position - nearby.centre;
  const float distance = length(step);
  if (!(distance > 0.0f && distance < kSmallStep * nearby.reach)) return query.position;
  return query.position + step * (kInReach * (kReachOfRadii - 1.0f) * radius / distance);
}

/// Looks up the blocks around the query and beyond it; false when there are too many to keep.
template <typename V>
bool look_around(const PhotonTree& tree, const DiscQuery& query, float radius, NearbyBlocks& nearby) {
  constexpr std::size_t kWidth = PhotonTree::kWidth;
  if (nearby.queries_to_skip > 0) {
    --nearby.queries_to_skip;
    return false;
  }
  DiscQuery wide = query;
  wide.position = centre_ahead(nearby, query, radius);
  wide.radius2 = kReachOfRadii * kReachOfRadii * query.radius2;
  BlockList list;
  const std::size_t count = list_blocks(tree, QueryLanes<V>(wide), list);
  if (count > NearbyBlocks::kMost) {
    nearby.reach = -1.0f;
    nearby.queries_to_skip = kQueriesToSkip;
    return false;
  }
  nearby.centre = wide.position;
  nearby.reach = kReachOfRadii * radius;
  nearby.count = count;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t block = nearby.blocks[i] = list[i];
    const PhotonTree::Node& from = tree.levels().front()[block / kWidth];
    PhotonTree::Node& to = nearby.boxes[i / kWidth];
    for (std::size_t a = 0; a < 3; ++a) {
      to.lower[a][i % kWidth] = from.lower[a][block % kWidth];
      to.upper[a][i % kWidth] = from.upper[a][block % kWidth];
    }
  }
  for (std::size_t i = count; i % kWidth != 0; ++i) {  // boxes that nothing meets
    for (auto& lower : nearby.boxes[i / kWidth].lower) lower[i % kWidth] = kInfinity;
    for (auto& upper : nearby.boxes[i / kWidth].upper) upper[i % kWidth] = -kInfinity;
  }
  return true;
}

/// Lists the blocks among the nearby ones whose box meets the ball, in ascending order, and returns their number.
template <typename V>
std::size_t list_nearby(const NearbyBlocks& nearby, const QueryLanes<V>& lanes, BlockList& list) {
  constexpr auto kWidth = static_cast<std::uint32_t>(PhotonTree::kWidth);
  std::size_t found = 0;
  for (std::uint32_t i = 0; i < nearby.count; i += kWidth) {
    const std::uint32_t met = lanes.boxes(nearby.boxes[i / kWidth]);
    V::append(list.data() + found, met, i);
    found += static_cast<std::size_t>(std::popcount(met));
  }
  for (std::size_t i = 0; i < found; ++i) list[i] = nearby.blocks[list[i]];
  return found;
}

/// Calls visit(index) for every block whose box meets the ball, in ascending order.
template <typename V, typename Visit>
void for_each_block(const PhotonTree& tree, const QueryLanes<V>& lanes, NearbyBlocks* nearby, Visit&& visit) {
  BlockList list;
  std::size_t count = 0;
  const float radius = std::sqrt(lanes.query.radius2);
  if (nearby != nullptr &&
      (reaches(*nearby, lanes.query, radius) || look_around<V>(tree, lanes.query, radius, *nearby))) {
    count = list_nearby(*nearby, lanes, list);
  } else {
    count = list_blocks(tree, lanes, list);
    if (count > kMostListed) return walk_blocks(tree, lanes, visit);
  }
  for (std::size_t i = 0; i < count; ++i) visit(std::size_t{list[i]});
}

template <typename V>
std::uint32_t count_photons(const PhotonTree& tree, const DiscQuery& query, NearbyBlocks* nearby) {
  QueryLanes<V> lanes(query);
  std::uint32_t count = 0;
  for_each_block<V>(tree, lanes, nearby, [&](std::size_t block) {
    count += static_cast<std::uint32_t>(std::popcount(V::bits(lanes.photons(tree, block))));
  });
  return count;
}

template <typename V>
FluxSum sum_photons(const PhotonTree& tree, const DiscQuery& query, NearbyBlocks* nearby) {
  QueryLanes<V> lanes(query);
  typename V::Narrow count = V::no_steps();  // stays in a register, where a plain integer would not
  typename V::Steps r{}, g{}, b{};
  const std::uint32_t room = tree.blocks_in_32_bits();
  if (room == 0) {
    for_each_block<V>(tree, lanes, nearby, [&](std::size_t block) {
      const auto mask = lanes.photons(tree, block);
      const PhotonTree::Block& p = tree.blocks()[block];
      V::add_one(count, mask);
      V::add_steps(r, mask, V::load(p.r.data()));
      V::add_steps(g, mask, V::load(p.g.data()));
      V::add_steps(b, mask, V::load(p.b.data()));
    });
  } else {
    typename V::Narrow narrow_r = V::no_steps(), narrow_g = V::no_steps(), narrow_b = V::no_steps();
    const auto empty = [&] {
      V::widen(r, narrow_r), V::widen(g, narrow_g), V::widen(b, narrow_b);
      narrow_r = narrow_g = narrow_b = V::no_steps();
    };
    std::uint32_t left = room;
    for_each_block<V>(tree, lanes, nearby, [&](std::size_t block) {
      const auto mask = lanes.photons(tree, block);
      const PhotonTree::Block& p = tree.blocks()[block];
      V::add_one(count, mask);
      V::add_narrow(narrow_r, mask, V::load(p.r.data()));
      V::add_narrow(narrow_g, mask, V::load(p.g.data()));
      V::add_narrow(narrow_b, mask, V::load(p.b.data()));
      if (--left == 0) {
        empty();
        left = room;
      }
    });
    empty();
  }
  return {V::total(count), {V::total(r), V::total(g), V::total(b)}};
}

template <typename V>
void collect_photons(const PhotonTree& tree, const DiscQuery& query, NearbyBlocks* nearby,
                     std::vector<std::uint32_t>& indices) {
  QueryLanes<V> lanes(query);
  for_each_block<V>(tree, lanes, nearby, [&](std::size_t block) {
    const auto first = static_cast<std::uint32_t>(block * PhotonTree::kWidth);
    for (std::uint32_t bits = V::bits(lanes.photons(tree, block)); bits != 0; bits &= bits - 1) {
      indices.push_back(first + static_cast<std::uint32_t>(std::countr_zero(bits)));
    }
  });
}

template <typename V>
constexpr GatherKernels make_gather_kernels() {
  return {count_photons<V>, sum_photons<V>, collect_photons<V>};
}

}  // namespace
}  // namespace pf
