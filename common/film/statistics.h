#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/base/result.h"
#include "common/math/vec.h"

namespace pf {

/// Photons are kept apart by what they did since the light: `kCaustic` met only specular surfaces (L S+ D), `kIndirect`
/// all others that count (direct light is sampled from the eye). Each flow has its own radius: a narrow one for the
/// caustic's edge, a wide one for smooth indirect light.
enum Flow : std::size_t { kCaustic = 0, kIndirect = 1, kFlows = 2 };

/// One pixel of a result: sums over sub-passes as exact integers, so that adding results has no order and no grouping.
/// What one step of each integer stands for is in SumScale.
struct PixelSums {
  std::array<std::int64_t, 3> direct{};                    ///< radiance: emission seen and direct light
  std::array<std::array<std::int64_t, 3>, kFlows> flow{};  ///< flux (shared mode) or radiance (independent, path)
  std::int64_t square = 0;                                 ///< squared luminance, for the error estimate
  std::array<std::uint32_t, kFlows> photons{};             ///< photons found (M of the papers)

  friend bool operator==(const PixelSums&, const PixelSums&) = default;
};

/// Sums of albedo, normal and depth use the first eye samples only: those layers are there to guide denoisers and
/// people, and 15 antialiased samples show all they can; 15 also keep their sums in the 16 bytes below.
inline constexpr std::uint64_t kFeatureSubPasses = 15;

/// What one pixel's first eye samples met, summed.
struct FeatureSums {
  std::array<std::int16_t, 3> albedo{};  ///< in steps of SumScale::kUnit
  std::array<std::int16_t, 3> normal{};
  std::uint32_t depth_and_samples =
      0;  ///< depth in steps of SumScale::depth, times 16, plus the samples: both add up as one

  static constexpr double kMaxDepthSteps = 0x1p24;  ///< of a sample: fifteen of them fit 28 bits
  [[nodiscard]] std::uint32_t samples() const { return depth_and_samples & 15u; }
  [[nodiscard]] std::uint32_t depth() const { return depth_and_samples >> 4; }
  void add_depth(double steps) {
    depth_and_samples += static_cast<std::uint32_t>(std::lrint(std::min(steps, kMaxDepthSteps))) * 16u + 1u;
  }
  friend bool operator==(const FeatureSums&, const FeatureSums&) = default;
};

/// What only some methods sum per pixel, and what its four integers then mean.
enum class Extra : std::uint8_t {
  kNone,
  kSpecular,  ///< radiance seen through sharp reflections or refractions, in steps of SumScale::radiance; and nothing
  kGatherPoints,  ///< the same, and how often a gather point was placed here
  kCacheRecords,  ///< the same, and how often a record of the irradiance cache was placed here
  kBias  ///< of each flow, luminance times 6 d^2/R^2 - 3 over the photons found, in steps of SumScale::flow: what the
         ///< disc adds to its middle's radiance; and nothing
};
struct ExtraSums {
  std::array<std::int64_t, 3> rgb{};  ///< or the flows' sums
  std::int64_t marks = 0;

  friend bool operator==(const ExtraSums&, const ExtraSums&) = default;
};

/// Steps of the fixed-point sums. Powers of two that follow from the scene's emitted flux and the spec alone.
struct SumScale {
  double radiance = 0x1p-24;                ///< W sr^-1 m^-2 per step of `direct` (and of `flow` outside shared mode)
  double flow = 0x1p-24;                    ///< per step of `flow`
  double square = 0x1p-16;                  ///< (W sr^-1 m^-2)^2 per step
  double depth = 0x1p-18;                   ///< metres per step
  static constexpr double kUnit = 0x1p-11;  ///< step of albedo and normal

  /// `mean_radiance`: emitted flux / (pi * area of the scene's bounds); `photon_flux`: flux of one photon path in W
  /// (0 unless shared mode); `diagonal`: of the bounds in metres.
  [[nodiscard]] static SumScale from_scene(double mean_radiance, double photon_flux, double diagonal);
};

/// `value` in whole steps, rounded to nearest. Not finite or beyond 2^62 steps: false, `sum` unchanged.
[[nodiscard]] inline bool add_quantised(std::int64_t& sum, double value, double step) {
  const double steps = value / step;
  if (!(std::abs(steps) < 0x1p62)) return false;
  std::int64_t added = 0;
  if (__builtin_add_overflow(sum, static_cast<std::int64_t>(std::llrint(steps)), &added)) return false;
  sum = added;
  return true;
}
[[nodiscard]] inline bool add_quantised(std::array<std::int64_t, 3>& sum, const Rgb& value, double step) {
  const bool x = add_quantised(sum[0], value.x, step);
  const bool y = add_quantised(sum[1], value.y, step);
  const bool z = add_quantised(sum[2], value.z, step);
  return x && y && z;
}

/// Things that went wrong with single contributions; any of them makes the job report its cause.
struct Faults {
  std::uint64_t not_finite = 0;  ///< contributions that were NaN or infinite and were left out
  std::uint64_t overflow = 0;    ///< sums beyond 63 bits
  Faults& operator+=(const Faults& o) {
    not_finite += o.not_finite;
    overflow += o.overflow;
    return *this;
  }
};

/// Result of a work unit, or the sum of many: pixel sums and figures of the work behind them.
struct Statistics {
  int width = 0;
  int height = 0;
  std::vector<PixelSums> pixels;  ///< row by row from the top
  std::vector<FeatureSums>
      features;                   ///< likewise; may be empty in results that hold no sub-pass below kFeatureSubPasses
  std::vector<ExtraSums> extras;  ///< likewise; empty for Extra::kNone
  std::uint64_t sub_passes = 0;
  std::uint64_t photon_paths = 0;
  std::uint64_t photons_stored = 0;
  std::uint64_t rays = 0;
  Faults faults;

  Statistics() = default;
  Statistics(int w, int h, bool with_features = true, bool with_extras = false)
      : width(w),
        height(h),
        pixels(static_cast<std::size_t>(w) * static_cast<std::size_t>(h)),
        features(with_features ? pixels.size() : 0),
        extras(with_extras ? pixels.size() : 0) {}
  /// Makes room for what a sub-pass with this eye sample sums beside pixels.
  void make_room(std::uint64_t sample, Extra extra) {
    if (sample < kFeatureSubPasses && features.empty()) features.resize(pixels.size());
    if (extra != Extra::kNone && extras.empty()) extras.resize(pixels.size());
  }
  /// Adds another result of the same size. Error (kInternal) when a sum overflows.
  [[nodiscard]] Result<void> add(const Statistics& other);
};

}  // namespace pf
