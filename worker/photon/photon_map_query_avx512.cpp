#include <immintrin.h>

#include "worker/photon/photon_map_query.inl"

namespace pf {
namespace {

/// Sixteen floats in one register.
struct Avx512 {
  using Float = __m512;
  static Float set(float v) { return _mm512_set1_ps(v); }
  static Float load(const float* p) { return _mm512_loadu_ps(p); }
  static void store(float* p, Float v) { _mm512_storeu_ps(p, v); }
  static Float add(Float a, Float b) { return _mm512_add_ps(a, b); }
  static Float sub(Float a, Float b) { return _mm512_sub_ps(a, b); }
  static Float mul(Float a, Float b) { return _mm512_mul_ps(a, b); }
  static Float min(Float a, Float b) { return _mm512_min_ps(a, b); }
  static Float max(Float a, Float b) { return _mm512_max_ps(a, b); }
  static Float abs(Float a) { return _mm512_abs_ps(a); }
  /// `size`, never negative, with the sign of `v`.
  static Float with_sign_of(Float size, Float v) { return _mm512_or_ps(size, _mm512_and_ps(v, _mm512_set1_ps(-0.0f))); }
  static std::uint32_t not_above(Float a, Float b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
  static std::uint32_t below(Float a, Float b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
  /// `a` where it is not above `b`, else 0.
  static Float where_not_above(Float a, Float b) {
    return _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(a, b, _CMP_LE_OQ), a);
  }
  /// `a` where it is above `b`, else infinite.
  static Float where_above(Float a, Float b) {
    return _mm512_mask_mov_ps(set(kInfinity), _mm512_cmp_ps_mask(a, b, _CMP_GT_OQ), a);
  }
  static float largest(Float a) { return _mm512_reduce_max_ps(a); }
  static float smallest(Float a) { return _mm512_reduce_min_ps(a); }
  static void load_octahedral(const std::uint16_t* packed, Float& u, Float& v) {
    const __m512i both = _mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(packed)));
    u = _mm512_cvtepi32_ps(_mm512_and_si512(both, _mm512_set1_epi32(127)));
    v = _mm512_cvtepi32_ps(_mm512_srli_epi32(both, 7));
  }
  /// Writes the lanes that are set, moved together, and leaves the rest of 16 entries undefined.
  static void append(float* to, std::uint32_t bits, Float v) {
    _mm512_storeu_ps(to, _mm512_maskz_compress_ps(static_cast<__mmask16>(bits), v));
  }
  static void append(std::uint32_t* to, std::uint32_t bits, __m512i v) {
    _mm512_storeu_si512(to, _mm512_maskz_compress_epi32(static_cast<__mmask16>(bits), v));
  }
  /// The same with entries [from, from + 16) of `all`, to `to` before them.
  static void append_moved(std::uint32_t* all, std::size_t to, std::size_t from, std::uint32_t bits) {
    append(all + to, bits, _mm512_loadu_si512(all + from));
  }
  /// The same with the numbers of a brick's nodes.
  static void append_nodes(std::uint32_t* to, std::uint32_t root, std::uint32_t bits) {
    const __m512i below = _mm512_setr_epi32(0, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 3, 3, 3, 3, 4);
    const __m512i place = _mm512_setr_epi32(0, 0, 1, 0, 1, 2, 3, 0, 1, 2, 3, 4, 5, 6, 7, 0);
    append(to, bits, _mm512_add_epi32(_mm512_sllv_epi32(_mm512_set1_epi32(static_cast<int>(root)), below), place));
  }
};

}  // namespace

const MapKernels& map_kernels_avx512() {
  static constexpr MapKernels kKernels = make_map_kernels<Avx512>();
  return kKernels;
}

}  // namespace pf
