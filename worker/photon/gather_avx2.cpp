#include <immintrin.h>

#include "worker/photon/gather_kernels.inl"

namespace pf {
namespace {

/// For every set of eight lanes their numbers, ascending, a byte each.
constexpr std::array<std::uint64_t, 256> lanes_of_sets() {
  std::array<std::uint64_t, 256> table{};
  for (unsigned set = 0; set < 256; ++set) {
    int place = 0;
    for (unsigned lane = 0; lane < 8; ++lane) {
      if ((set >> lane & 1) == 0) continue;
      table[set] |= std::uint64_t{lane} << place;
      place += 8;
    }
  }
  return table;
}
constexpr std::array<std::uint64_t, 256> kLanesOfSets = lanes_of_sets();

/// Sixteen floats in two registers.
struct Avx2 {
  struct Float {
    __m256 low, high;
  };
  using Mask = Float;
  struct Bits {
    __m256i low, high;
  };
  struct Steps {
    __m256i sum = _mm256_setzero_si256();
  };
  using Narrow = Bits;
  static Narrow no_steps() { return {_mm256_setzero_si256(), _mm256_setzero_si256()}; }
  static Mask none() { return {_mm256_setzero_ps(), _mm256_setzero_ps()}; }
  static Float set(float v) { return {_mm256_set1_ps(v), _mm256_set1_ps(v)}; }
  static Float load(const float* p) { return {_mm256_load_ps(p), _mm256_load_ps(p + 8)}; }
  static Float add(Float a, Float b) { return {_mm256_add_ps(a.low, b.low), _mm256_add_ps(a.high, b.high)}; }
  static Float sub(Float a, Float b) { return {_mm256_sub_ps(a.low, b.low), _mm256_sub_ps(a.high, b.high)}; }
  static Float mul(Float a, Float b) { return {_mm256_mul_ps(a.low, b.low), _mm256_mul_ps(a.high, b.high)}; }
  static Float min(Float a, Float b) { return {_mm256_min_ps(a.low, b.low), _mm256_min_ps(a.high, b.high)}; }
  static Float max(Float a, Float b) { return {_mm256_max_ps(a.low, b.low), _mm256_max_ps(a.high, b.high)}; }
  static Float abs(Float a) {
    const __m256 sign = _mm256_set1_ps(-0.0f);
    return {_mm256_andnot_ps(sign, a.low), _mm256_andnot_ps(sign, a.high)};
  }
  static Mask less_equal(Float a, Float b) {
    return {_mm256_cmp_ps(a.low, b.low, _CMP_LE_OQ), _mm256_cmp_ps(a.high, b.high, _CMP_LE_OQ)};
  }
  static Mask both(Mask a, Mask b) { return {_mm256_and_ps(a.low, b.low), _mm256_and_ps(a.high, b.high)}; }
  static std::uint32_t bits(Mask m) {
    return static_cast<std::uint32_t>(_mm256_movemask_ps(m.low)) |
           static_cast<std::uint32_t>(_mm256_movemask_ps(m.high)) << 8;
  }
  /// Writes base + i for every bit i that is set, ascending, and leaves the rest of 16 entries undefined.
  static void append(std::uint32_t* to, std::uint32_t bits, std::uint32_t base) {
    const auto store = [](std::uint32_t* at, std::uint32_t set, std::uint32_t first) {
      const __m128i lanes = _mm_cvtsi64_si128(static_cast<long long>(kLanesOfSets[set]));
      const __m256i all = _mm256_add_epi32(_mm256_cvtepu8_epi32(lanes), _mm256_set1_epi32(static_cast<int>(first)));
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(at), all);
    };
    store(to, bits & 0xFF, base);
    store(to + std::popcount(bits & 0xFF), bits >> 8, base + 8);
  }
  static Bits load_bits(const std::uint32_t* p) {
    return {_mm256_load_si256(reinterpret_cast<const __m256i*>(p)),
            _mm256_load_si256(reinterpret_cast<const __m256i*>(p + 8))};
  }
  static Float signed_byte(Bits v, int byte) {
    const int up = 24 - 8 * byte;
    return {_mm256_cvtepi32_ps(_mm256_srai_epi32(_mm256_slli_epi32(v.low, up), 24)),
            _mm256_cvtepi32_ps(_mm256_srai_epi32(_mm256_slli_epi32(v.high, up), 24))};
  }
  /// Nearest integer of each double below 2^51 in size: adding 1.5 * 2^52 leaves it in the low bits.
  static __m256i rounded(__m256d v) {
    const __m256d magic = _mm256_set1_pd(0x1.8p52);
    return _mm256_sub_epi64(_mm256_castpd_si256(_mm256_add_pd(v, magic)), _mm256_castpd_si256(magic));
  }
  static void add_steps(Steps& s, Mask mask, Float flux) {
    const __m256d scale = _mm256_set1_pd(kFluxSteps);
    for (const __m256 half : {_mm256_and_ps(flux.low, mask.low), _mm256_and_ps(flux.high, mask.high)}) {
      const __m256d a = _mm256_mul_pd(_mm256_cvtps_pd(_mm256_castps256_ps128(half)), scale);
      const __m256d b = _mm256_mul_pd(_mm256_cvtps_pd(_mm256_extractf128_ps(half, 1)), scale);
      s.sum = _mm256_add_epi64(s.sum, _mm256_add_epi64(rounded(a), rounded(b)));
    }
  }
  static void add_narrow(Narrow& sum, Mask mask, Float flux) {
    const Float steps = mul({_mm256_and_ps(flux.low, mask.low), _mm256_and_ps(flux.high, mask.high)},
                            set(static_cast<float>(kFluxSteps)));
    sum.low = _mm256_add_epi32(sum.low, _mm256_cvtps_epi32(steps.low));
    sum.high = _mm256_add_epi32(sum.high, _mm256_cvtps_epi32(steps.high));
  }
  static void add_one(Narrow& count, Mask mask) {  // a mask's lanes are minus one
    count.low = _mm256_sub_epi32(count.low, _mm256_castps_si256(mask.low));
    count.high = _mm256_sub_epi32(count.high, _mm256_castps_si256(mask.high));
  }
  static std::uint32_t total(const Narrow& count) {
    alignas(32) std::uint32_t lanes[8];
    _mm256_store_si256(reinterpret_cast<__m256i*>(lanes), _mm256_add_epi32(count.low, count.high));
    std::uint32_t sum = 0;
    for (const std::uint32_t lane : lanes) sum += lane;
    return sum;
  }
  static void widen(Steps& sum, const Narrow& steps) {
    for (const __m256i half : {steps.low, steps.high}) {
      sum.sum = _mm256_add_epi64(sum.sum, _mm256_cvtepi32_epi64(_mm256_castsi256_si128(half)));
      sum.sum = _mm256_add_epi64(sum.sum, _mm256_cvtepi32_epi64(_mm256_extracti128_si256(half, 1)));
    }
  }
  static std::int64_t total(const Steps& s) {
    alignas(32) std::int64_t lanes[4];
    _mm256_store_si256(reinterpret_cast<__m256i*>(lanes), s.sum);
    return lanes[0] + lanes[1] + lanes[2] + lanes[3];
  }
};

}  // namespace

const GatherKernels& gather_kernels_avx2() {
  static constexpr GatherKernels kKernels = make_gather_kernels<Avx2>();
  return kKernels;
}

}  // namespace pf
