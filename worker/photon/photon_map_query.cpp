#include <immintrin.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "worker/photon/photon_map.h"

namespace pf {
namespace {

constexpr float kInversePlaneTolerance2 = 1.0f / (kPlaneTolerance * kPlaneTolerance);
/// Coordinates of the octahedral normals: 0..kNormalMapSteps becomes -1..1.
constexpr float kNormalStep = 2.0f / kNormalMapSteps;

/// Distance as NearestQuery counts it. Here and in lanes with the same operations in the same order.
float distance2_of(const NearestQuery& query, const StoredPhoton& photon) {
  const float x = query.position.x - photon.position[0];
  const float y = query.position.y - photon.position[1];
  const float z = query.position.z - photon.position[2];
  const float height = x * query.normal.x + y * query.normal.y + z * query.normal.z;
  return std::max(x * x + y * y + z * z, height * height * kInversePlaneTolerance2);
}

bool faces(const NearestQuery& query, const StoredPhoton& photon) {
  const unsigned packed = static_cast<unsigned>(photon.flags) >> 2;
  float u = static_cast<float>(packed & 127u) * kNormalStep - 1.0f;
  float v = static_cast<float>(packed >> 7) * kNormalStep - 1.0f;
  const float z = 1.0f - std::abs(u) - std::abs(v);
  const float fold = std::max(-z, 0.0f);
  u -= std::copysign(fold, u);
  v -= std::copysign(fold, v);
  float facing = u * query.normal.x + v * query.normal.y + z * query.normal.z;
  if (query.both_sides) facing = std::abs(facing);
  return facing >= kMinNormalCosine * std::sqrt(u * u + v * v + z * z);
}

std::size_t count_not_above(const float* values, std::size_t count, float bound) {
  const __m256 limit = _mm256_set1_ps(bound);
  __m256i found = _mm256_setzero_si256();
  for (std::size_t i = 0; i < count; i += 8) {
    const __m256 below = _mm256_cmp_ps(_mm256_loadu_ps(values + i), limit, _CMP_LE_OQ);
    found = _mm256_sub_epi32(found, _mm256_castps_si256(below));
  }
  alignas(32) std::array<std::uint32_t, 8> lanes;
  _mm256_store_si256(reinterpret_cast<__m256i*>(lanes.data()), found);
  std::size_t total = 0;
  for (const std::uint32_t lane : lanes) total += lane;
  return total;
}

/// Largest of the values up to `bound`; 0 when there is none.
float largest_not_above(const float* values, std::size_t count, float bound) {
  const __m256 limit = _mm256_set1_ps(bound);
  __m256 largest = _mm256_setzero_ps();
  for (std::size_t i = 0; i < count; i += 8) {
    const __m256 value = _mm256_loadu_ps(values + i);
    largest = _mm256_max_ps(largest, _mm256_and_ps(value, _mm256_cmp_ps(value, limit, _CMP_LE_OQ)));
  }
  alignas(32) std::array<float, 8> lanes;
  _mm256_store_ps(lanes.data(), largest);
  return *std::max_element(lanes.begin(), lanes.end());
}

/// The k-th smallest of `count` >= k values, none negative; values[count..] must be infinite up to a multiple
/// of eight. Photons on a surface are spread evenly over squared distance, so that interpolating finds it in
/// a few rounds of counting.
float kth_smallest(const float* values, std::size_t count, std::size_t k) {
  float low = 0.0f, high = largest_not_above(values, count, std::numeric_limits<float>::max());
  if (count == k) return high;
  std::size_t below_low = 0, below_high = count;
  constexpr int kInterpolations = 6;
  for (int round = 0; round < kInterpolations; ++round) {
    const float share =
        (static_cast<float>(k - below_low) - 0.5f) / static_cast<float>(below_high - below_low);
    const float middle = low + (high - low) * share;
    const std::size_t below = count_not_above(values, count, middle);
    if (below == k) return largest_not_above(values, count, middle);
    if (below > k) {
      high = middle;
      below_high = below;
    } else {
      low = middle;
      below_low = below;
    }
  }
  // Few are left between the bounds, unless many photons lie at one place.
  thread_local std::vector<float> rest;
  rest.clear();
  std::copy_if(values, values + count, std::back_inserter(rest),
               [&](float v) { return v <= high && (v > low || below_low == 0); });
  const auto wanted = rest.begin() + static_cast<std::ptrdiff_t>(k - below_low - 1);
  std::nth_element(rest.begin(), wanted, rest.end());
  return *wanted;
}

}  // namespace

/// One query on its way through the tree: inner nodes one by one, nearest side first and their own photon
/// before the far side, and the last four levels below a node as fifteen photons at once, eight to a
/// register.
class MapWalk {
 public:
  MapWalk(const PhotonMap& map, const NearestQuery& query)
      : map_(map), query_(query), radius2_(query.max_distance2) {
    for (int axis = 0; axis < 3; ++axis) {
      position_[axis] = _mm256_set1_ps(query.position[axis]);
      normal_[axis] = _mm256_set1_ps(query.normal[axis]);
    }
  }

  /// Calls take(index, distance2) for photons within radius2(), which `take` may lower, nearer parts of the
  /// tree first; take8(indices, distances2, bits) for those of a register.
  template <typename Take, typename Take8>
  void run(const Take& take, const Take8& take8) {
    struct Pending {
      std::uint32_t node;           ///< far side of its parent's plane
      float distance2;              ///< to its cell
      std::array<float, 3> offset;  ///< from the query to its cell
    };
    std::array<Pending, 33> stack;  // a level each
    std::size_t depth = 0;
    std::uint32_t node = 1;
    std::array<float, 3> offset{0.0f, 0.0f, 0.0f};
    const auto count = static_cast<std::uint32_t>(map_.count_);
    while (true) {
      while (node < map_.first_root_) {
        const StoredPhoton& photon = map_.photons_[node];
        const unsigned axis = photon.axis();
        const float to_plane = query_.position[static_cast<int>(axis)] - photon.position[axis];
        node = 2 * node + (to_plane > 0.0f ? 1u : 0u);
        Pending& far = stack[depth];
        far.node = node ^ 1u;
        far.offset = offset;
        far.offset[axis] = to_plane;
        // The photons' own sum of squares in the same order: rounding never puts a cell beyond a photon in
        // it.
        far.distance2 =
            far.offset[0] * far.offset[0] + far.offset[1] * far.offset[1] + far.offset[2] * far.offset[2];
        depth += far.distance2 <= radius2_ ? 1 : 0;
      }
      if (node <= count) last_levels(node, take8);
      do {
        if (depth == 0) return;
        --depth;
      } while (stack[depth].distance2 > radius2_);
      node = stack[depth].node;
      offset = stack[depth].offset;
      // The photon on the plane is at least as far away as what lies behind it: only now can it count.
      const StoredPhoton& parent = map_.photons_[node / 2];
      const float distance2 = distance2_of(query_, parent);
      if (distance2 <= radius2_ && faces(query_, parent)) take(node / 2, distance2);
    }
  }
  [[nodiscard]] float radius2() const { return radius2_; }
  void lower(float radius2) { radius2_ = radius2; }

 private:
  template <typename Take8>
  void last_levels(std::uint32_t root, const Take8& take8) {
    // The root, its two children, their four children, and the root again, which does not count; then the
    // last level.
    const StoredPhoton* photons = map_.photons_.data();
    const std::size_t r = root, count = map_.count_;
    const __m256i at = _mm256_set1_epi32(static_cast<int>(root));
    const __m256i upper = _mm256_add_epi32(_mm256_sllv_epi32(at, _mm256_setr_epi32(0, 1, 1, 2, 2, 2, 2, 0)),
                                           _mm256_setr_epi32(0, 0, 1, 0, 1, 2, 3, 0));
    const __m256i lower =
        _mm256_add_epi32(_mm256_slli_epi32(at, 3), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
    if (8 * r + 7 <= count) {
      const StoredPhoton *c = photons + 2 * r, *g = photons + 4 * r, *l = photons + 8 * r;
      eight({photons + r, c, c + 1, g, g + 1, g + 2, g + 3, photons + r}, upper, 0x7Fu, take8);
      eight({l, l + 1, l + 2, l + 3, l + 4, l + 5, l + 6, l + 7}, lower, 0xFFu, take8);
      return;
    }
    // At the tree's ragged end: nodes that are not there are the last one again, and do not count.
    for (const __m256i& nodes : {upper, lower}) {
      std::array<std::uint32_t, 8> node;
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(node.data()), nodes);
      Eight eight_photons{};
      std::uint32_t valid = 0;
      for (std::size_t i = 0; i < 8; ++i) {
        eight_photons[i] = photons + std::min(std::size_t{node[i]}, count);
        valid |= node[i] <= count ? 1u << i : 0u;
      }
      if (valid != 0) eight(eight_photons, nodes, &nodes == &lower ? valid : valid & 0x7Fu, take8);
    }
  }

  using Eight = std::array<const StoredPhoton*, 8>;

  template <typename Take8>
  [[gnu::always_inline]] void eight(const Eight& photons, __m256i nodes, std::uint32_t valid,
                                    const Take8& take8) {
    // Four words of each photon, x y z flux, turned into registers of x, y and z: faster than gather
    // instructions.
    const auto pair = [&](std::size_t low, std::size_t high) {
      const __m128 first = _mm_loadu_ps(photons[low]->position.data());
      return _mm256_insertf128_ps(_mm256_castps128_ps256(first), _mm_loadu_ps(photons[high]->position.data()),
                                  1);
    };
    const __m256 p04 = pair(0, 4), p15 = pair(1, 5), p26 = pair(2, 6), p37 = pair(3, 7);
    const __m256 xy01 = _mm256_unpacklo_ps(p04, p15), xy23 = _mm256_unpacklo_ps(p26, p37);
    const __m256 z01 = _mm256_unpackhi_ps(p04, p15), z23 = _mm256_unpackhi_ps(p26, p37);
    const __m256 x = _mm256_sub_ps(position_[0], _mm256_shuffle_ps(xy01, xy23, _MM_SHUFFLE(1, 0, 1, 0)));
    const __m256 y = _mm256_sub_ps(position_[1], _mm256_shuffle_ps(xy01, xy23, _MM_SHUFFLE(3, 2, 3, 2)));
    const __m256 z = _mm256_sub_ps(position_[2], _mm256_shuffle_ps(z01, z23, _MM_SHUFFLE(1, 0, 1, 0)));
    const __m256 height = sum3(x, normal_[0], y, normal_[1], z, normal_[2]);
    const __m256 off_plane =
        _mm256_mul_ps(_mm256_mul_ps(height, height), _mm256_set1_ps(kInversePlaneTolerance2));
    const __m256 distance2 = _mm256_max_ps(sum3(x, x, y, y, z, z), off_plane);
    const __m256 near = _mm256_cmp_ps(distance2, _mm256_set1_ps(radius2_), _CMP_LE_OQ);
    std::uint32_t bits = static_cast<std::uint32_t>(_mm256_movemask_ps(near)) & valid;
    if (bits == 0) return;
    const auto flags = [&](std::size_t i) { return static_cast<int>(photons[i]->flags); };
    const __m256i packed =
        _mm256_setr_epi32(flags(0), flags(1), flags(2), flags(3), flags(4), flags(5), flags(6), flags(7));
    bits &= static_cast<std::uint32_t>(_mm256_movemask_ps(facing(_mm256_srli_epi32(packed, 2))));
    if (bits != 0) take8(nodes, distance2, bits);
  }

  static __m256 sum3(__m256 a, __m256 b, __m256 c, __m256 d, __m256 e, __m256 f) {
    return _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(a, b), _mm256_mul_ps(c, d)), _mm256_mul_ps(e, f));
  }
  /// As faces(), from the normals of eight photons.
  [[nodiscard]] __m256 facing(__m256i packed) const {
    const __m256 sign = _mm256_set1_ps(-0.0f), one = _mm256_set1_ps(1.0f), step = _mm256_set1_ps(kNormalStep);
    const __m256 first = _mm256_cvtepi32_ps(_mm256_and_si256(packed, _mm256_set1_epi32(127)));
    const __m256 second = _mm256_cvtepi32_ps(_mm256_srli_epi32(packed, 7));
    __m256 u = _mm256_sub_ps(_mm256_mul_ps(first, step), one);
    __m256 v = _mm256_sub_ps(_mm256_mul_ps(second, step), one);
    const __m256 z = _mm256_sub_ps(_mm256_sub_ps(one, _mm256_andnot_ps(sign, u)), _mm256_andnot_ps(sign, v));
    const __m256 fold = _mm256_max_ps(_mm256_xor_ps(z, sign), _mm256_setzero_ps());
    u = _mm256_sub_ps(u, _mm256_or_ps(fold, _mm256_and_ps(sign, u)));
    v = _mm256_sub_ps(v, _mm256_or_ps(fold, _mm256_and_ps(sign, v)));
    __m256 cosine = sum3(u, normal_[0], v, normal_[1], z, normal_[2]);
    if (query_.both_sides) cosine = _mm256_andnot_ps(sign, cosine);
    const __m256 size = _mm256_sqrt_ps(sum3(u, u, v, v, z, z));
    return _mm256_cmp_ps(cosine, _mm256_mul_ps(size, _mm256_set1_ps(kMinNormalCosine)), _CMP_GE_OQ);
  }

  const PhotonMap& map_;
  const NearestQuery& query_;
  float radius2_;
  __m256 position_[3], normal_[3];
};

namespace {

/// Photons found so far, and which of them can still be among the nearest.
class Candidates {
 public:
  Candidates(MapWalk& walk, NearestPhotons& found, std::size_t nearest)
      : walk_(walk), found_(found), nearest_(nearest), limit_(2 * nearest + kSpare) {
    const std::size_t room = limit_ + 3 * 8;
    if (found.index.size() < room) {
      found.index.resize(room);
      found.distance2.resize(room);
    }
    found.count = 0;
  }

  void take(std::uint32_t index, float distance2) {
    found_.index[found_.count] = index;
    found_.distance2[found_.count] = distance2;
    if (++found_.count >= limit_) drop_far(nearest_);
  }
  void take8(__m256i indices, __m256 distances2, std::uint32_t bits) {
    store(found_.count, indices, distances2, bits);
    found_.count += static_cast<std::size_t>(std::popcount(bits));
    if (found_.count >= limit_) drop_far(nearest_);
  }
  /// Leaves the disc of NearestPhotons.
  void finish(float max_distance2) {
    found_.radius2 = max_distance2;
    const std::size_t k = std::isinf(max_distance2) ? std::min(nearest_, found_.count) : nearest_;
    if (k == 0 || found_.count < k) return;
    close();
    found_.radius2 = kth_smallest(found_.distance2.data(), found_.count, k);
    keep(found_.radius2, k - 1);
  }

 private:
  static constexpr std::size_t kSpare = 24;

  /// Ends the list with infinite distances, for whole registers.
  void close() { _mm256_storeu_ps(found_.distance2.data() + found_.count, _mm256_set1_ps(kInfinity)); }
  void drop_far(std::size_t k) {
    close();
    const float radius2 = kth_smallest(found_.distance2.data(), found_.count, k);
    keep(radius2, k);
    walk_.lower(radius2);
  }
  /// Keeps the nearest `k` of the photons within `radius2`; of those exactly at it the first ones.
  void keep(float radius2, std::size_t k) {
    const __m256 limit = _mm256_set1_ps(radius2);
    std::size_t kept = 0, ties = 0;
    for (std::size_t i = 0; i < found_.count; i += 8) {
      const __m256 distances2 = _mm256_loadu_ps(found_.distance2.data() + i);
      const __m256i indices = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(found_.index.data() + i));
      const auto nearer =
          static_cast<std::uint32_t>(_mm256_movemask_ps(_mm256_cmp_ps(distances2, limit, _CMP_LT_OQ)));
      const auto tied =
          static_cast<std::uint32_t>(_mm256_movemask_ps(_mm256_cmp_ps(distances2, limit, _CMP_EQ_OQ)));
      store(kept, indices, distances2, nearer | tied);
      kept += static_cast<std::size_t>(std::popcount(nearer | tied));
      ties += static_cast<std::size_t>(std::popcount(tied));
    }
    found_.count = kept;
    // Ties past the k-th go, the last ones first.
    for (std::size_t i = kept; kept > k && ties > 0 && i-- > 0;) {
      if (found_.distance2[i] != radius2) continue;
      std::copy(found_.distance2.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                found_.distance2.begin() + static_cast<std::ptrdiff_t>(found_.count),
                found_.distance2.begin() + static_cast<std::ptrdiff_t>(i));
      std::copy(found_.index.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                found_.index.begin() + static_cast<std::ptrdiff_t>(found_.count),
                found_.index.begin() + static_cast<std::ptrdiff_t>(i));
      --found_.count;
      --kept;
      --ties;
    }
  }
  /// Writes the lanes that are set, moved together; what lies after them is overwritten.
  void store(std::size_t at, __m256i indices, __m256 distances2, std::uint32_t bits) {
    // Numbers of the lanes, a byte each, picked by the bits spread to bytes.
    const std::uint64_t bytes = _pdep_u64(bits, 0x0101010101010101u) * 0xFFu;
    const __m256i lanes = _mm256_cvtepu8_epi32(
        _mm_cvtsi64_si128(static_cast<long long>(_pext_u64(0x0706050403020100u, bytes))));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(found_.index.data() + at),
                        _mm256_permutevar8x32_epi32(indices, lanes));
    _mm256_storeu_ps(found_.distance2.data() + at, _mm256_permutevar8x32_ps(distances2, lanes));
  }

  MapWalk& walk_;
  NearestPhotons& found_;
  std::size_t nearest_, limit_;
};

}  // namespace

void PhotonMap::nearest(const NearestQuery& query, NearestPhotons& found) const {
  // What the last answer needed, and a little more, will mostly do for this one; when it does not, all is
  // searched. The answer is the same, in the same order.
  constexpr float kMore = 1.4f;
  const float hint2 = kMore * found.radius2;
  for (const float bound2 : {hint2, query.max_distance2}) {
    if (bound2 < query.max_distance2 ? !(bound2 > 0.0f) : bound2 > query.max_distance2) continue;
    MapWalk walk(*this, query);
    walk.lower(bound2);
    Candidates candidates(walk, found, query.nearest);
    if (!empty()) {
      walk.run([&](std::uint32_t index, float distance2) { candidates.take(index, distance2); },
               [&](__m256i indices, __m256 distances2, std::uint32_t bits) {
                 candidates.take8(indices, distances2, bits);
               });
    }
    if (bound2 < query.max_distance2 && found.count < query.nearest) continue;
    candidates.finish(query.max_distance2);
    return;
  }
}

std::uint32_t PhotonMap::nearest_one(const NearestQuery& query) const {
  if (empty()) return 0;
  MapWalk walk(*this, query);
  std::uint32_t nearest = 0;
  const auto take = [&](std::uint32_t index, float distance2) {
    // At equal distance the first one stays, unless there is none yet.
    if (nearest != 0 && distance2 >= walk.radius2()) return;
    nearest = index;
    walk.lower(distance2);
  };
  walk.run(take, [&](__m256i indices, __m256 distances2, std::uint32_t bits) {
    alignas(32) std::array<std::uint32_t, 8> index;
    alignas(32) std::array<float, 8> distance2;
    _mm256_store_si256(reinterpret_cast<__m256i*>(index.data()), indices);
    _mm256_store_ps(distance2.data(), distances2);
    for (; bits != 0; bits &= bits - 1) {
      const auto lane = static_cast<std::size_t>(std::countr_zero(bits));
      take(index[lane], distance2[lane]);
    }
  });
  return nearest;
}

float PhotonMap::distance2(const NearestQuery& query, std::uint32_t index) const {
  const StoredPhoton& photon = photons_[index];
  const float distance2 = distance2_of(query, photon);
  return distance2 <= query.max_distance2 && faces(query, photon) ? distance2 : kInfinity;
}

}  // namespace pf
