// Query code over a vector type V of 16 floats; included by one source per instruction set. Every operation is
// elementwise and correctly rounded, and sums are integers: all instruction sets give the same bits.

#include <bit>

#include "worker/photon/photon_tree.h"

namespace pf {
namespace {

template <typename V>
struct QueryLanes {
  typename V::Float px, py, pz, nx, ny, nz, radius2, plane, cosine;
  bool both_sides;

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
        both_sides(q.both_sides) {}

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

  /// Mask of the accepted photons of the block at `first`.
  [[nodiscard]] typename V::Mask photons(const PhotonArrays& p, std::size_t first) const {
    const auto dx = V::sub(V::load(&p.x[first]), px);
    const auto dy = V::sub(V::load(&p.y[first]), py);
    const auto dz = V::sub(V::load(&p.z[first]), pz);
    const auto d2 = V::add(V::add(V::mul(dx, dx), V::mul(dy, dy)), V::mul(dz, dz));
    const auto near = V::less_equal(d2, radius2);
    if (V::bits(near) == 0) return near;
    const auto height = V::add(V::add(V::mul(dx, nx), V::mul(dy, ny)), V::mul(dz, nz));
    const auto normal = V::load_bits(&p.normal[first]);
    auto facing = V::add(V::add(V::mul(V::signed_byte(normal, 0), nx), V::mul(V::signed_byte(normal, 1), ny)),
                         V::mul(V::signed_byte(normal, 2), nz));
    if (both_sides) facing = V::abs(facing);
    return V::both(near, V::both(V::less_equal(V::abs(height), plane), V::less_equal(cosine, facing)));
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
  const QueryLanes<V> lanes(query);
  std::uint32_t count = 0;
  for_each_block<V>(tree, lanes, [&](std::size_t first) {
    count += static_cast<std::uint32_t>(std::popcount(V::bits(lanes.photons(tree.photons(), first))));
  });
  return count;
}

template <typename V>
FluxSum sum_photons(const PhotonTree& tree, const DiscQuery& query) {
  const QueryLanes<V> lanes(query);
  FluxSum sum;
  typename V::Steps r{}, g{}, b{};
  for_each_block<V>(tree, lanes, [&](std::size_t first) {
    const auto mask = lanes.photons(tree.photons(), first);
    const std::uint32_t bits = V::bits(mask);
    if (bits == 0) return;
    sum.count += static_cast<std::uint32_t>(std::popcount(bits));
    V::add_steps(r, mask, V::load(&tree.photons().r[first]));
    V::add_steps(g, mask, V::load(&tree.photons().g[first]));
    V::add_steps(b, mask, V::load(&tree.photons().b[first]));
  });
  sum.steps = {V::total(r), V::total(g), V::total(b)};
  return sum;
}

template <typename V>
void collect_photons(const PhotonTree& tree, const DiscQuery& query, std::vector<std::uint32_t>& indices) {
  const QueryLanes<V> lanes(query);
  for_each_block<V>(tree, lanes, [&](std::size_t first) {
    for (std::uint32_t bits = V::bits(lanes.photons(tree.photons(), first)); bits != 0; bits &= bits - 1) {
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
