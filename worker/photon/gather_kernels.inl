// Query code over a vector type V of 16 floats; included by one source per instruction set. Every operation is
// elementwise and correctly rounded, and sums are integers: all instruction sets give the same bits.

#include <bit>

#include "worker/photon/photon_tree.h"

namespace pf {
namespace {

template <typename V>
struct QueryLanes {
  typename V::Float px, py, pz, nx, ny, nz, radius2, plane, cosine;
  const DiscQuery& query;
  std::uint32_t seen_normal = PhotonTree::kMixedNormals;   ///< of the last block, and whether its photons face the query
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

  /// Bit i: box i of the node at `first` meets the ball.
  [[nodiscard]] std::uint32_t boxes(const PhotonTree::Level& level, std::size_t first) const {
    const auto axis = [&](std::size_t a, const typename V::Float& p) {
      const auto below = V::sub(V::load(&level.lower[a][first]), p);
      const auto above = V::sub(p, V::load(&level.upper[a][first]));
      const auto d = V::max(V::max(below, above), V::set(0.0f));
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

  /// Mask of the accepted photons of the block at `first`.
  [[nodiscard]] typename V::Mask photons(const PhotonTree& tree, std::size_t first) {
    const std::uint32_t packed = tree.block_normal(first);
    if (packed != PhotonTree::kMixedNormals && !block_faces(packed)) return V::none();
    const PhotonArrays& p = tree.photons();
    const auto dx = V::sub(V::load(&p.x[first]), px);
    const auto dy = V::sub(V::load(&p.y[first]), py);
    const auto dz = V::sub(V::load(&p.z[first]), pz);
    const auto d2 = V::add(V::add(V::mul(dx, dx), V::mul(dy, dy)), V::mul(dz, dz));
    const auto height = V::add(V::add(V::mul(dx, nx), V::mul(dy, ny)), V::mul(dz, nz));
    const auto mask = V::both(V::less_equal(d2, radius2), V::less_equal(V::abs(height), plane));
    if (packed != PhotonTree::kMixedNormals) return mask;
    const auto normal = V::load_bits(&p.normal[first]);
    auto facing = V::add(V::add(V::mul(V::signed_byte(normal, 0), nx), V::mul(V::signed_byte(normal, 1), ny)),
                         V::mul(V::signed_byte(normal, 2), nz));
    if (query.both_sides) facing = V::abs(facing);
    return V::both(mask, V::less_equal(cosine, facing));
  }
};

/// Calls visit(first photon of the block) for every block whose box meets the ball, in ascending order.
template <typename V, typename Visit>
void for_each_block(const PhotonTree& tree, const QueryLanes<V>& lanes, Visit&& visit) {
  constexpr std::size_t kWidth = PhotonTree::kWidth;
  const auto& levels = tree.levels();
  // At most one pending mask per level; 16^8 blocks of 16 photons are more than 32 bits can index.
  constexpr std::size_t kMaxLevels = 9;
  std::uint32_t pending[kMaxLevels];
  std::size_t node[kMaxLevels];
  std::size_t depth = levels.size() - 1;
  node[depth] = 0;
  pending[depth] = lanes.boxes(levels[depth], 0);
  while (true) {
    if (pending[depth] == 0) {
      if (++depth == levels.size()) return;
      continue;
    }
    const auto child = node[depth] * kWidth + static_cast<std::size_t>(std::countr_zero(pending[depth]));
    pending[depth] &= pending[depth] - 1;
    if (depth == 0) {
      visit(child * kWidth);
    } else {
      --depth;
      node[depth] = child;
      pending[depth] = lanes.boxes(levels[depth], child * kWidth);
    }
  }
}

template <typename V>
std::uint32_t count_photons(const PhotonTree& tree, const DiscQuery& query) {
  QueryLanes<V> lanes(query);
  std::uint32_t count = 0;
  for_each_block<V>(tree, lanes, [&](std::size_t first) {
    count += static_cast<std::uint32_t>(std::popcount(V::bits(lanes.photons(tree, first))));
  });
  return count;
}

template <typename V>
FluxSum sum_photons(const PhotonTree& tree, const DiscQuery& query) {
  QueryLanes<V> lanes(query);
  FluxSum sum;
  typename V::Steps r{}, g{}, b{};
  const PhotonArrays& p = tree.photons();
  const std::uint32_t room = tree.blocks_in_32_bits();
  if (room == 0) {
    for_each_block<V>(tree, lanes, [&](std::size_t first) {
      const auto mask = lanes.photons(tree, first);
      sum.count += static_cast<std::uint32_t>(std::popcount(V::bits(mask)));
      V::add_steps(r, mask, V::load(&p.r[first]));
      V::add_steps(g, mask, V::load(&p.g[first]));
      V::add_steps(b, mask, V::load(&p.b[first]));
    });
  } else {
    typename V::Narrow narrow_r = V::no_steps(), narrow_g = V::no_steps(), narrow_b = V::no_steps();
    const auto empty = [&] {
      V::widen(r, narrow_r), V::widen(g, narrow_g), V::widen(b, narrow_b);
      narrow_r = narrow_g = narrow_b = V::no_steps();
    };
    std::uint32_t left = room;
    for_each_block<V>(tree, lanes, [&](std::size_t first) {
      const auto mask = lanes.photons(tree, first);
      const std::uint32_t bits = V::bits(mask);
      if (bits == 0) return;
      sum.count += static_cast<std::uint32_t>(std::popcount(bits));
      V::add_narrow(narrow_r, mask, V::load(&p.r[first]));
      V::add_narrow(narrow_g, mask, V::load(&p.g[first]));
      V::add_narrow(narrow_b, mask, V::load(&p.b[first]));
      if (--left == 0) {
        empty();
        left = room;
      }
    });
    empty();
  }
  sum.steps = {V::total(r), V::total(g), V::total(b)};
  return sum;
}

template <typename V>
void collect_photons(const PhotonTree& tree, const DiscQuery& query, std::vector<std::uint32_t>& indices) {
  QueryLanes<V> lanes(query);
  for_each_block<V>(tree, lanes, [&](std::size_t first) {
    for (std::uint32_t bits = V::bits(lanes.photons(tree, first)); bits != 0; bits &= bits - 1) {
      indices.push_back(static_cast<std::uint32_t>(first) + static_cast<std::uint32_t>(std::countr_zero(bits)));
    }
  });
}

template <typename V>
constexpr GatherKernels make_gather_kernels() {
  return {count_photons<V>, sum_photons<V>, collect_photons<V>};
}

}  // namespace
}  // namespace pf
