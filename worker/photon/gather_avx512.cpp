#include <immintrin.h>

#include "worker/photon/gather_kernels.inl"

namespace pf {
namespace {

/// Sixteen floats in one register.
struct Avx512 {
  using Float = __m512;
  using Mask = __mmask16;
  struct Steps {
    __m512i low = _mm512_setzero_si512();
    __m512i high = _mm512_setzero_si512();
  };
  using Narrow = __m512i;
  static Narrow no_steps() { return _mm512_setzero_si512(); }
  static Mask none() { return 0; }
  static Float set(float v) { return _mm512_set1_ps(v); }
  static Float load(const float* p) { return _mm512_load_ps(p); }
  static Float add(Float a, Float b) { return _mm512_add_ps(a, b); }
  static Float sub(Float a, Float b) { return _mm512_sub_ps(a, b); }
  static Float mul(Float a, Float b) { return _mm512_mul_ps(a, b); }
  static Float min(Float a, Float b) { return _mm512_min_ps(a, b); }
  static Float max(Float a, Float b) { return _mm512_max_ps(a, b); }
  static Float abs(Float a) { return _mm512_abs_ps(a); }
  static Mask less_equal(Float a, Float b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
  static Mask both(Mask a, Mask b) { return static_cast<Mask>(a & b); }
  static std::uint32_t bits(Mask m) { return m; }
  /// Writes base + i for every bit i that is set, ascending, and leaves the rest of 16 entries undefined.
  static void append(std::uint32_t* to, std::uint32_t bits, std::uint32_t base) {
    const __m512i lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    const __m512i all = _mm512_add_epi32(lanes, _mm512_set1_epi32(static_cast<int>(base)));
    _mm512_storeu_si512(to, _mm512_maskz_compress_epi32(static_cast<__mmask16>(bits), all));
  }
  static __m512i load_bits(const std::uint32_t* p) { return _mm512_load_si512(p); }
  static Float signed_byte(__m512i v, int byte) {
    const auto up = static_cast<unsigned>(24 - 8 * byte);
    return _mm512_cvtepi32_ps(_mm512_srai_epi32(_mm512_slli_epi32(v, up), 24));
  }
  static void add_steps(Steps& sum, Mask mask, Float flux) {
    const Float steps = _mm512_mul_ps(flux, set(static_cast<float>(kFluxSteps)));
    const __m512i low = _mm512_cvtps_epi64(_mm512_castps512_ps256(steps));
    const __m512i high = _mm512_cvtps_epi64(_mm512_extractf32x8_ps(steps, 1));
    sum.low = _mm512_mask_add_epi64(sum.low, static_cast<__mmask8>(mask), sum.low, low);
    sum.high = _mm512_mask_add_epi64(sum.high, static_cast<__mmask8>(mask >> 8), sum.high, high);
  }
  static void add_narrow(Narrow& sum, Mask mask, Float flux) {
    const __m512i steps = _mm512_cvtps_epi32(_mm512_mul_ps(flux, set(static_cast<float>(kFluxSteps))));
    sum = _mm512_mask_add_epi32(sum, mask, sum, steps);
  }
  static void add_one(Narrow& count, Mask mask) {
    count = _mm512_mask_add_epi32(count, mask, count, _mm512_set1_epi32(1));
  }
  static std::uint32_t total(const Narrow& count) { return static_cast<std::uint32_t>(_mm512_reduce_add_epi32(count)); }
  static void widen(Steps& sum, const Narrow& steps) {
    sum.low = _mm512_add_epi64(sum.low, _mm512_cvtepi32_epi64(_mm512_castsi512_si256(steps)));
    sum.high = _mm512_add_epi64(sum.high, _mm512_cvtepi32_epi64(_mm512_extracti64x4_epi64(steps, 1)));
  }
  static std::int64_t total(const Steps& s) { return _mm512_reduce_add_epi64(_mm512_add_epi64(s.low, s.high)); }
};

}  // namespace

const GatherKernels& gather_kernels_avx512() {
  static constexpr GatherKernels kKernels = make_gather_kernels<Avx512>();
  return kKernels;
}

}  // namespace pf
