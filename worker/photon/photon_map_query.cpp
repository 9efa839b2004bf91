#include <immintrin.h>

#include <iterator>
#include <vector>

#include "worker/photon/photon_map_query.inl"

namespace pf {
namespace {

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
  const float fold = std::max(0.0f - z, 0.0f);
  u -= std::copysign(fold, u);
  v -= std::copysign(fold, v);
  float facing = u * query.normal.x + v * query.normal.y + z * query.normal.z;
  facing = std::max(query.both_sides ? std::abs(facing) : facing, 0.0f);
  return (u * u + v * v + z * z) * (kMinNormalCosine * kMinNormalCosine) <= facing * facing;
}

/// Sixteen floats in two registers.
struct Avx2 {
  struct Float {
    __m256 low, high;
  };
  static Float set(float v) { return {_mm256_set1_ps(v), _mm256_set1_ps(v)}; }
  static Float load(const float* p) { return {_mm256_loadu_ps(p), _mm256_loadu_ps(p + 8)}; }
  static void store(float* p, Float v) { _mm256_storeu_ps(p, v.low), _mm256_storeu_ps(p + 8, v.high); }
  static Float add(Float a, Float b) { return {_mm256_add_ps(a.low, b.low), _mm256_add_ps(a.high, b.high)}; }
  static Float sub(Float a, Float b) { return {_mm256_sub_ps(a.low, b.low), _mm256_sub_ps(a.high, b.high)}; }
  static Float mul(Float a, Float b) { return {_mm256_mul_ps(a.low, b.low), _mm256_mul_ps(a.high, b.high)}; }
  static Float min(Float a, Float b) { return {_mm256_min_ps(a.low, b.low), _mm256_min_ps(a.high, b.high)}; }
  static Float max(Float a, Float b) { return {_mm256_max_ps(a.low, b.low), _mm256_max_ps(a.high, b.high)}; }
  static Float abs(Float a) {
    const __m256 sign = _mm256_set1_ps(-0.0f);
    return {_mm256_andnot_ps(sign, a.low), _mm256_andnot_ps(sign, a.high)};
  }
  /// `size`, never negative, with the sign of `v`.
  static Float with_sign_of(Float size, Float v) {
    const __m256 sign = _mm256_set1_ps(-0.0f);
    return {_mm256_or_ps(size.low, _mm256_and_ps(v.low, sign)), _mm256_or_ps(size.high, _mm256_and_ps(v.high, sign))};
  }
  template <int kCompare>
  static Float compare(Float a, Float b) {
    return {_mm256_cmp_ps(a.low, b.low, kCompare), _mm256_cmp_ps(a.high, b.high, kCompare)};
  }
  static std::uint32_t bits_of(Float mask) {
    return static_cast<std::uint32_t>(_mm256_movemask_ps(mask.low)) |
           static_cast<std::uint32_t>(_mm256_movemask_ps(mask.high)) << 8;
  }
  static std::uint32_t not_above(Float a, Float b) { return bits_of(compare<_CMP_LE_OQ>(a, b)); }
  static std::uint32_t below(Float a, Float b) { return bits_of(compare<_CMP_LT_OQ>(a, b)); }
  /// `a` where it is not above `b`, else 0.
  static Float where_not_above(Float a, Float b) {
    const Float mask = compare<_CMP_LE_OQ>(a, b);
    return {_mm256_and_ps(a.low, mask.low), _mm256_and_ps(a.high, mask.high)};
  }
  /// `a` where it is above `b`, else infinite.
  static Float where_above(Float a, Float b) {
    const Float mask = compare<_CMP_GT_OQ>(a, b), none = set(kInfinity);
    return {_mm256_blendv_ps(none.low, a.low, mask.low), _mm256_blendv_ps(none.high, a.high, mask.high)};
  }
  static float largest(Float a) {
    return reduce(a, [](float x, float y) { return std::max(x, y); });
  }
  static float smallest(Float a) {
    return reduce(a, [](float x, float y) { return std::min(x, y); });
  }
  static void load_octahedral(const std::uint16_t* packed, Float& u, Float& v) {
    const auto half = [&](std::size_t first, __m256& of_u, __m256& of_v) {
      const __m256i both = _mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(packed + first)));
      of_u = _mm256_cvtepi32_ps(_mm256_and_si256(both, _mm256_set1_epi32(127)));
      of_v = _mm256_cvtepi32_ps(_mm256_srli_epi32(both, 7));
    };
    half(0, u.low, v.low);
    half(8, u.high, v.high);
  }
  /// Writes the lanes that are set, moved together, and leaves the rest of 16 entries undefined.
  static void append(float* to, std::uint32_t bits, Float v) {
    const std::uint32_t low = bits & 0xFFu;
    _mm256_storeu_ps(to, _mm256_permutevar8x32_ps(v.low, lanes(low)));
    _mm256_storeu_ps(to + std::popcount(low), _mm256_permutevar8x32_ps(v.high, lanes(bits >> 8)));
  }
  static void append(std::uint32_t* to, std::uint32_t bits, __m256i first, __m256i last) {
    const std::uint32_t low = bits & 0xFFu;
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), _mm256_permutevar8x32_epi32(first, lanes(low)));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(to + std::popcount(low)),
                        _mm256_permutevar8x32_epi32(last, lanes(bits >> 8)));
  }
  /// The same with entries [from, from + 16) of `all`, to `to` before them.
  static void append_moved(std::uint32_t* all, std::size_t to, std::size_t from, std::uint32_t bits) {
    const auto* half = reinterpret_cast<const __m256i*>(all + from);
    append(all + to, bits, _mm256_loadu_si256(half), _mm256_loadu_si256(half + 1));
  }
  /// The same with the numbers of a brick's nodes.
  static void append_nodes(std::uint32_t* to, std::uint32_t root, std::uint32_t bits) {
    const __m256i at = _mm256_set1_epi32(static_cast<int>(root));
    const auto half = [&](__m256i below, __m256i place) {
      return _mm256_add_epi32(_mm256_sllv_epi32(at, below), place);
    };
    append(to, bits, half(_mm256_setr_epi32(0, 1, 1, 2, 2, 2, 2, 3), _mm256_setr_epi32(0, 0, 1, 0, 1, 2, 3, 0)),
           half(_mm256_setr_epi32(3, 3, 3, 3, 3, 3, 3, 4), _mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 0)));
  }

 private:
  /// Numbers of the lanes that are set, ascending.
  static __m256i lanes(std::uint32_t bits) {
    const std::uint64_t bytes = _pdep_u64(bits, 0x0101010101010101u) * 0xFFu;
    return _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(_pext_u64(0x0706050403020100u, bytes))));
  }
  template <typename F>
  static float reduce(Float a, const F& f) {
    std::array<float, 16> lanes;
    store(lanes.data(), a);
    float result = lanes[0];
    for (const float lane : lanes) result = f(result, lane);
    return result;
  }
};

}  // namespace

const MapKernels& map_kernels_avx2() {
  static constexpr MapKernels kKernels = make_map_kernels<Avx2>();
  return kKernels;
}

namespace {
const MapKernels& brick_kernels(PhotonTree::Isa isa) {
  return isa == PhotonTree::Isa::kAvx512 ? map_kernels_avx512() : map_kernels_avx2();
}
}  // namespace

float kth_between(const float* values, std::size_t count, float low, float high, bool with_low, std::size_t k) {
  thread_local std::vector<float> between;
  between.clear();
  std::copy_if(values, values + count, std::back_inserter(between),
               [&](float v) { return v <= high && (v > low || with_low); });
  const auto wanted = between.begin() + static_cast<std::ptrdiff_t>(k - 1);
  std::nth_element(between.begin(), wanted, between.end());
  return *wanted;
}

void PhotonMap::nearest(const NearestQuery& query, NearestPhotons& found) const {
  const std::size_t room = most_candidates(query.nearest) + 3 * MapBricks::kWidth;
  if (found.index.size() < room) {
    found.index.resize(room);
    found.distance2.resize(room);
  }
  if (!empty()) return brick_kernels(isa_).nearest(bricks_, query, found);
  found.count = 0;
  found.radius2 = query.max_distance2;
}

std::uint32_t PhotonMap::nearest_one(const NearestQuery& query) const {
  return empty() ? 0 : brick_kernels(isa_).nearest_one(bricks_, query);
}

float PhotonMap::distance2(const NearestQuery& query, std::uint32_t index) const {
  const StoredPhoton& photon = photons_[index];
  const float distance2 = distance2_of(query, photon);
  return distance2 <= query.max_distance2 && faces(query, photon) ? distance2 : kInfinity;
}

}  // namespace pf
