// Query code over a vector type V of 16 floats; included by one source per instruction set. Every operation
// is elementwise and correctly rounded, and photons come in the tree's order: all instruction sets give the
// same bits.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "worker/photon/photon_map.h"
#include "worker/photon/photon_map_bricks.h"

namespace pf {
namespace {

constexpr float kInversePlaneTolerance2 = 1.0f / (kPlaneTolerance * kPlaneTolerance);
/// Coordinates of the octahedral normals: 0..kNormalMapSteps becomes -1..1.
constexpr float kNormalStep = 2.0f / kNormalMapSteps;

/// One query on its way through the bricks, in the tree's order.
template <typename V>
class BrickWalk {
 public:
  using Float = typename V::Float;

  BrickWalk(const MapBricks& bricks, const NearestQuery& query, float radius2)
      : bricks_(bricks), query_(query), radius2_(radius2) {
    for (int axis = 0; axis < 3; ++axis) {
      position_[axis] = V::set(query.position[axis]);
      normal_[axis] = V::set(query.normal[axis]);
    }
  }

  /// Calls take(root of the brick, bits of its lanes, squared distances) for photons within radius2(), which
  /// `take` may lower.
  template <typename Take>
  void run(const Take& take) {
    struct Pending {
      std::uint32_t first;  ///< child 0
      std::uint32_t left;   ///< bits of the children yet to be visited
    };
    std::array<Pending, MapBricks::kMostLevels> pending;
    const MapBricks::Level* levels = bricks_.levels().data();
    const std::size_t last = bricks_.levels().size() - 1;
    std::size_t level = 0;
    std::uint32_t root = 1;
    while (true) {
      const std::size_t index = levels[level].brick(root);
      photons(index, root, take);
      pending[level] = {root << levels[level].height, 0};
      if (level < last)
        pending[level].left = children(index, levels[level + 1], levels[level].height, pending[level].first);
      while (pending[level].left == 0) {
        if (level-- == 0) return;
      }
      Pending& here = pending[level];
      root = here.first + static_cast<std::uint32_t>(std::countr_zero(here.left));
      here.left &= here.left - 1;
      ++level;
    }
  }
  /// Visits one brick a level, the nearest child each.
  template <typename Take>
  void dive(const Take& take) {
    const std::vector<MapBricks::Level>& levels = bricks_.levels();
    std::uint32_t root = 1;
    for (std::size_t level = 0;; ++level) {
      const std::size_t index = levels[level].brick(root);
      photons(index, root, take);
      if (level + 1 == levels.size()) return;
      alignas(64) std::array<float, MapBricks::kWidth> distance2;
      V::store(distance2.data(), distance2_of_boxes(bricks_.boxes(index)));
      std::uint32_t nearest = 0;
      for (std::uint32_t child = 1; child < 1u << levels[level].height; ++child)
        nearest = distance2[child] < distance2[nearest] ? child : nearest;
      root = (root << levels[level].height) + nearest;
    }
  }
  [[nodiscard]] float radius2() const { return radius2_; }
  void lower(float radius2) { radius2_ = radius2; }

 private:
  static Float sum3(Float a, Float b, Float c, Float d, Float e, Float f) {
    return V::add(V::add(V::mul(a, b), V::mul(c, d)), V::mul(e, f));
  }
  /// The photons' own sum of squares in the same order: rounding never puts a box beyond a photon in it.
  [[nodiscard]] Float distance2_of_boxes(const MapBricks::Boxes& boxes) const {
    Float away[3];
    for (std::size_t a = 0; a < 3; ++a) {
      const Float below = V::sub(V::load(boxes.low[a].data()), position_[a]);
      const Float above = V::sub(position_[a], V::load(boxes.high[a].data()));
      away[a] = V::max(V::max(below, above), V::set(0.0f));
    }
    return sum3(away[0], away[0], away[1], away[1], away[2], away[2]);
  }
  [[nodiscard]] std::uint32_t children(std::size_t index, const MapBricks::Level& next, unsigned height,
                                       std::uint32_t first) const {
    const std::uint32_t exist = (std::uint32_t{1} << (1u << height)) - 1u;
    const std::uint32_t bits = exist & V::not_above(distance2_of_boxes(bricks_.boxes(index)), V::set(radius2_));
    const MapBricks::Brick* bricks = &bricks_.brick(next.brick(first));
    for (std::uint32_t left = bits; left != 0; left &= left - 1) {
      const auto* lines = reinterpret_cast<const char*>(bricks + std::countr_zero(left));
      for (std::size_t byte = 0; byte < sizeof(MapBricks::Brick); byte += 64) __builtin_prefetch(lines + byte);
    }
    return bits;
  }
  template <typename Take>
  void photons(std::size_t index, std::uint32_t root, const Take& take) const {
    const MapBricks::Brick& brick = bricks_.brick(index);
    const Float x = V::sub(position_[0], V::load(brick.x.data()));
    const Float y = V::sub(position_[1], V::load(brick.y.data()));
    const Float z = V::sub(position_[2], V::load(brick.z.data()));
    const Float height = sum3(x, normal_[0], y, normal_[1], z, normal_[2]);
    const Float off_plane = V::mul(V::mul(height, height), V::set(kInversePlaneTolerance2));
    const Float distance2 = V::max(sum3(x, x, y, y, z, z), off_plane);
    std::uint32_t bits = V::not_above(distance2, V::set(radius2_));
    if (bits == 0) return;
    bits &= facing(brick.normal.data());
    if (bits != 0) take(root, bits, distance2);
  }
  /// As faces().
  [[nodiscard]] std::uint32_t facing(const std::uint16_t* packed) const {
    const Float one = V::set(1.0f), step = V::set(kNormalStep), zero = V::set(0.0f);
    Float u, v;
    V::load_octahedral(packed, u, v);
    u = V::sub(V::mul(u, step), one);
    v = V::sub(V::mul(v, step), one);
    const Float z = V::sub(V::sub(one, V::abs(u)), V::abs(v));
    const Float fold = V::max(V::sub(zero, z), zero);
    u = V::sub(u, V::with_sign_of(fold, u));
    v = V::sub(v, V::with_sign_of(fold, v));
    Float cosine = sum3(u, normal_[0], v, normal_[1], z, normal_[2]);
    if (query_.both_sides) cosine = V::abs(cosine);
    const Float least = V::mul(sum3(u, u, v, v, z, z), V::set(kMinNormalCosine * kMinNormalCosine));
    // Of what looks away, nothing is left of the cosine.
    cosine = V::max(cosine, zero);
    return V::not_above(least, V::mul(cosine, cosine));
  }

  const MapBricks& bricks_;
  const NearestQuery& query_;
  float radius2_;
  Float position_[3], normal_[3];
};

/// Photons found so far, and which of them can still be among the nearest. Lists end with infinite distances
/// up to a multiple of 16 when they are counted.
template <typename V>
class Candidates {
 public:
  using Float = typename V::Float;

  Candidates(BrickWalk<V>& walk, NearestPhotons& found, std::size_t nearest)
      : walk_(walk), found_(found), nearest_(nearest), limit_(most_candidates(nearest)) {
    found.count = 0;
  }

  void take(std::uint32_t root, std::uint32_t bits, Float distance2) {
    V::append_nodes(found_.index.data() + found_.count, root, bits);
    V::append(found_.distance2.data() + found_.count, bits, distance2);
    found_.count += static_cast<std::size_t>(std::popcount(bits));
    if (found_.count < limit_) return;
    const float radius2 = kth_smallest(nearest_);
    keep(radius2, nearest_);
    walk_.lower(radius2);
  }
  /// Leaves the disc of NearestPhotons.
  void finish(float max_distance2) {
    found_.radius2 = max_distance2;
    const std::size_t k = std::isinf(max_distance2) ? std::min(nearest_, found_.count) : nearest_;
    if (k == 0 || found_.count < k) return;
    found_.radius2 = kth_smallest(k);
    keep(found_.radius2, k - 1);
  }

 private:
  static constexpr std::size_t kWidth = MapBricks::kWidth;

  [[nodiscard]] Float distances2(std::size_t i) const { return V::load(found_.distance2.data() + i); }
  [[nodiscard]] std::size_t count_not_above(float bound) const {
    const Float limit = V::set(bound);
    std::size_t below = 0;
    for (std::size_t i = 0; i < found_.count; i += kWidth)
      below += static_cast<std::size_t>(std::popcount(V::not_above(distances2(i), limit)));
    return below;
  }
  /// Largest of the distances up to `bound`; 0 when there is none.
  [[nodiscard]] float largest_not_above(float bound) const {
    Float largest = V::set(0.0f);
    for (std::size_t i = 0; i < found_.count; i += kWidth)
      largest = V::max(largest, V::where_not_above(distances2(i), V::set(bound)));
    return V::largest(largest);
  }
  [[nodiscard]] float smallest_above(float bound) const {
    Float smallest = V::set(kInfinity);
    for (std::size_t i = 0; i < found_.count; i += kWidth)
      smallest = V::min(smallest, V::where_above(distances2(i), V::set(bound)));
    return V::smallest(smallest);
  }
  /// The k-th smallest distance of at least k. Photons on a surface are spread evenly over squared distance,
  /// so that interpolating finds it in a few rounds of counting.
  [[nodiscard]] float kth_smallest(std::size_t k) {
    V::store(found_.distance2.data() + found_.count, V::set(kInfinity));
    float low = 0.0f, high = largest_not_above(std::numeric_limits<float>::max());
    if (found_.count == k) return high;
    std::size_t below_low = 0, below_high = found_.count;
    constexpr int kInterpolations = 6;
    for (int round = 0; round < kInterpolations; ++round) {
      const float share = (static_cast<float>(k - below_low) - 0.5f) / static_cast<float>(below_high - below_low);
      const float middle = low + (high - low) * share;
      const std::size_t below = count_not_above(middle);
      if (below == k) return largest_not_above(middle);
      if (below + 1 == k) return smallest_above(middle);
      if (below > k) {
        high = middle;
        below_high = below;
      } else {
        low = middle;
        below_low = below;
      }
    }
    return kth_between(found_.distance2.data(), found_.count, low, high, below_low == 0, k - below_low);
  }
  /// Keeps the nearest `k` of the photons within `radius2`; of those exactly at it the first ones.
  void keep(float radius2, std::size_t k) {
    const Float limit = V::set(radius2);
    std::size_t nearer = 0;
    for (std::size_t i = 0; i < found_.count; i += kWidth)
      nearer += static_cast<std::size_t>(std::popcount(V::below(distances2(i), limit)));
    std::size_t ties = k > nearer ? k - nearer : 0, kept = 0;
    for (std::size_t i = 0; i < found_.count; i += kWidth) {
      const Float distance2 = distances2(i);
      std::uint32_t bits = V::below(distance2, limit);
      for (std::uint32_t tied = V::not_above(distance2, limit) & ~bits; tied != 0 && ties > 0; tied &= tied - 1, --ties)
        bits |= tied & -tied;
      V::append_moved(found_.index.data(), kept, i, bits);
      V::append(found_.distance2.data() + kept, bits, distance2);
      kept += static_cast<std::size_t>(std::popcount(bits));
    }
    found_.count = kept;
  }

  BrickWalk<V>& walk_;
  NearestPhotons& found_;
  std::size_t nearest_, limit_;
};

template <typename V>
void find_nearest(const MapBricks& bricks, const NearestQuery& query, NearestPhotons& found) {
  // What the last answer needed, and a little more, will mostly do for this one; where it does not, the disc
  // grows. The answer is the same, in the same order.
  constexpr float kMore = 1.4f, kGrowth = 4.0f;
  constexpr int kSteps = 4;  // then all: where there are not so many photons, growing would go on
  float bound2 = kMore * (found.radius2 > 0.0f ? found.radius2 : bricks.even_radius2(query.nearest));
  if (!(bound2 > 0.0f)) bound2 = query.max_distance2;
  for (int step = 0;; ++step) {
    bound2 = step < kSteps ? std::min(bound2, query.max_distance2) : query.max_distance2;
    BrickWalk<V> walk(bricks, query, bound2);
    Candidates<V> candidates(walk, found, query.nearest);
    walk.run([&](std::uint32_t root, std::uint32_t bits, typename V::Float distance2) {
      candidates.take(root, bits, distance2);
    });
    if (found.count >= query.nearest || bound2 == query.max_distance2) return candidates.finish(query.max_distance2);
    bound2 *= kGrowth;
  }
}

template <typename V>
std::uint32_t find_nearest_one(const MapBricks& bricks, const NearestQuery& query) {
  BrickWalk<V> walk(bricks, query, query.max_distance2);
  // How near one is at least, then the first one of those that are as near as any.
  walk.dive([&](std::uint32_t, std::uint32_t bits, typename V::Float distance2) {
    alignas(64) std::array<float, MapBricks::kWidth> lanes;
    V::store(lanes.data(), distance2);
    for (; bits != 0; bits &= bits - 1)
      walk.lower(std::min(walk.radius2(), lanes[static_cast<std::size_t>(std::countr_zero(bits))]));
  });
  std::uint32_t nearest = 0;
  walk.run([&](std::uint32_t root, std::uint32_t bits, typename V::Float distance2) {
    alignas(64) std::array<float, MapBricks::kWidth> lanes;
    V::store(lanes.data(), distance2);
    for (; bits != 0; bits &= bits - 1) {
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(bits));
      if (nearest != 0 && lanes[lane] >= walk.radius2()) continue;
      const auto below = static_cast<unsigned>(std::bit_width(lane + 1)) - 1;
      nearest = (root << below) + (lane + 1 - (1u << below));
      walk.lower(lanes[lane]);
    }
  });
  return nearest;
}

template <typename V>
constexpr MapKernels make_map_kernels() {
  return {find_nearest<V>, find_nearest_one<V>};
}

}  // namespace
}  // namespace pf
