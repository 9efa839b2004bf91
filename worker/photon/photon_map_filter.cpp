#include "worker/photon/photon_map_filter.h"

#include <immintrin.h>

#include <array>
#include <cmath>

namespace pf {
namespace {

constexpr float kCone = 1.1f;  ///< k of the cone filter
constexpr float kConeScale = 1.0f / (1.0f - 2.0f / (3.0f * kCone));
constexpr double kGaussianAlpha = 0.918, kGaussianBeta = 1.953;  ///< a and b

/// w = a - a (1 - e^(-b u^2/2)) / (1 - e^-b) = constant + factor * e^(-b u^2/2), divided by its mean over the
/// disc, constant + factor * (1 - e^(-b/2)) / (b/2): as a polynomial of u^2 around the middle of [0, 1],
/// whose terms fall so fast that the first left out is below 1e-8 of the sum.
class GaussianPolynomial {
 public:
  GaussianPolynomial() {
    const double share = 1.0 / (1.0 - std::exp(-kGaussianBeta));
    const double c = kGaussianAlpha * (1.0 - share), f = kGaussianAlpha * share;
    const double mean = c + f * (1.0 - std::exp(-0.5 * kGaussianBeta)) / (0.5 * kGaussianBeta);
    double term = f / mean * std::exp(-0.25 * kGaussianBeta);
    for (std::size_t power = 0; power < terms_.size(); ++power) {
      terms_[power] = static_cast<float>(term + (power == 0 ? c / mean : 0.0));
      term *= -0.5 * kGaussianBeta / static_cast<double>(power + 1);
    }
  }
  [[nodiscard]] __m256 operator()(__m256 u2) const {
    const __m256 x = _mm256_sub_ps(u2, _mm256_set1_ps(0.5f));
    __m256 sum = _mm256_set1_ps(terms_.back());
    for (std::size_t power = terms_.size() - 1; power-- > 0;)
      sum = _mm256_add_ps(_mm256_mul_ps(sum, x), _mm256_set1_ps(terms_[power]));
    return sum;
  }

 private:
  std::array<float, 8> terms_;
};

const GaussianPolynomial& gaussian() {
  static const GaussianPolynomial polynomial;
  return polynomial;
}

/// Sum of weight(u2) * flux over all photons found, eight at a time: lanes are added up in a fixed order.
template <typename Weight>
Rgb weighted_flux(const PhotonMap& map, const NearestPhotons& found, const Weight& weight) {
  if (found.count == 0) return {0.0f, 0.0f, 0.0f};
  const auto* words = reinterpret_cast<const int*>(&map.photon(0));
  const __m256 inverse = _mm256_set1_ps(1.0f / found.radius2);
  __m256 sums[3] = {_mm256_setzero_ps(), _mm256_setzero_ps(), _mm256_setzero_ps()};
  const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  const __m256i byte = _mm256_set1_epi32(255);
  for (std::size_t i = 0; i < found.count; i += 8) {
    const auto left = static_cast<int>(found.count - i);
    const __m256i used = _mm256_cmpgt_epi32(_mm256_set1_epi32(left), lane);
    const __m256i index = _mm256_and_si256(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(found.index.data() + i)),
                                           used);  // 0 where there is none: a photon
    const __m256i word = _mm256_add_epi32(_mm256_slli_epi32(index, 2), index);
    const __m256i rgbe = _mm256_i32gather_epi32(words + 3, word, 4);
    // 2^(e - 136) from its bits; e = 0 stands for black, whose mantissas are 0 as well.
    const __m256i exponent = _mm256_sub_epi32(_mm256_srli_epi32(rgbe, 24), _mm256_set1_epi32(136 - 127));
    const __m256 scale = _mm256_castsi256_ps(_mm256_slli_epi32(exponent, 23));
    const __m256 u2 = _mm256_mul_ps(_mm256_loadu_ps(found.distance2.data() + i), inverse);
    const __m256 factor = _mm256_and_ps(_mm256_castsi256_ps(used), _mm256_mul_ps(weight(u2), scale));
    for (int c = 0; c < 3; ++c) {
      const __m256i mantissa = _mm256_and_si256(_mm256_srli_epi32(rgbe, 8 * c), byte);
      sums[c] = _mm256_add_ps(sums[c], _mm256_mul_ps(_mm256_cvtepi32_ps(mantissa), factor));
    }
  }
  Rgb total;
  for (int c = 0; c < 3; ++c) {
    alignas(32) std::array<float, 8> lanes;
    _mm256_store_ps(lanes.data(), sums[c]);
    float sum = 0.0f;
    for (const float value : lanes) sum += value;
    total[c] = sum;
  }
  return total * (kInvPi / found.radius2);
}

}  // namespace

float MapFilter::weight(float u2) const {
  switch (filter_) {
    case PhotonFilter::kDisc:
      return 1.0f;
    case PhotonFilter::kCone:
      return (1.0f - std::sqrt(u2) / kCone) * kConeScale;
    case PhotonFilter::kGaussian:
      break;
  }
  return _mm256_cvtss_f32(gaussian()(_mm256_set1_ps(u2)));
}

Rgb MapFilter::irradiance(const PhotonMap& map, const NearestPhotons& found) const {
  switch (filter_) {
    case PhotonFilter::kDisc:
      return weighted_flux(map, found, [](__m256) { return _mm256_set1_ps(1.0f); });
    case PhotonFilter::kCone:
      return weighted_flux(map, found, [](__m256 u2) {
        const __m256 slope = _mm256_mul_ps(_mm256_sqrt_ps(u2), _mm256_set1_ps(kConeScale / kCone));
        return _mm256_sub_ps(_mm256_set1_ps(kConeScale), slope);
      });
    case PhotonFilter::kGaussian:
      break;
  }
  return weighted_flux(map, found, gaussian());
}

}  // namespace pf
