#include "common/film/statistics.h"

#include <cmath>

#include <fmt/format.h>

namespace pf {
namespace {

double power_of_two_near(double value) {
  if (!(value > 0.0) || !std::isfinite(value)) return 1.0;
  return std::exp2(std::round(std::log2(value)));
}

template <typename T>
bool add_exact(T& sum, T value) {
  return !__builtin_add_overflow(sum, value, &sum);
}

bool add_pixel(PixelSums& sum, const PixelSums& p) {
  bool exact = add_exact(sum.square, p.square);
  for (std::size_t c = 0; c < 3; ++c) {
    exact = exact && add_exact(sum.direct[c], p.direct[c]);
    for (std::size_t f = 0; f < kFlows; ++f) exact = exact && add_exact(sum.flow[f][c], p.flow[f][c]);
  }
  for (std::size_t f = 0; f < kFlows; ++f) exact = exact && add_exact(sum.photons[f], p.photons[f]);
  return exact;
}

bool add_features(FeatureSums& sum, const FeatureSums& f) {
  bool exact =
      sum.samples() + f.samples() <= kFeatureSubPasses && add_exact(sum.depth_and_samples, f.depth_and_samples);
  for (std::size_t c = 0; c < 3; ++c) {
    exact = exact && add_exact(sum.albedo[c], f.albedo[c]) && add_exact(sum.normal[c], f.normal[c]);
  }
  return exact;
}

bool add_extra(ExtraSums& sum, const ExtraSums& e) {
  bool exact = add_exact(sum.marks, e.marks);
  for (std::size_t c = 0; c < 3; ++c) exact = exact && add_exact(sum.rgb[c], e.rgb[c]);
  return exact;
}

}  // namespace

SumScale SumScale::from_scene(double mean_radiance, double photon_flux, double diagonal) {
  // 24 bits below the reference keep single samples as exact as a float holds them; the 39 bits above it hold 4096
  // samples of a lamp 10^8 times brighter than the scene's mean.
  constexpr double kFraction = 0x1p-24;
  SumScale scale;
  const double reference = power_of_two_near(mean_radiance);
  scale.radiance = reference * kFraction;
  scale.flow = photon_flux > 0.0 ? power_of_two_near(photon_flux) * kFraction : scale.radiance;
  scale.square = reference * reference * 0x1p-16;
  scale.depth = power_of_two_near(diagonal) * 0x1p-18;
  return scale;
}

Result<void> Statistics::add(const Statistics& other) {
  if (other.width != width || other.height != height) {
    return fail(ErrorKind::kInternal, fmt::format("statistics: a result of {}x{} cannot be added to one of {}x{}",
                                                  other.width, other.height, width, height));
  }
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (!add_pixel(pixels[i], other.pixels[i])) {
      return fail(ErrorKind::kInternal, fmt::format("statistics: sums of pixel {} overflow", i));
    }
  }
  if (features.empty()) features.resize(other.features.size());
  for (std::size_t i = 0; i < other.features.size(); ++i) {
    if (!add_features(features[i], other.features[i])) {
      return fail(ErrorKind::kInternal, fmt::format("statistics: features of pixel {} overflow", i));
    }
  }
  if (extras.empty()) extras.resize(other.extras.size());
  for (std::size_t i = 0; i < other.extras.size(); ++i) {
    if (!add_extra(extras[i], other.extras[i])) {
      return fail(ErrorKind::kInternal, fmt::format("statistics: extras of pixel {} overflow", i));
    }
  }
  sub_passes += other.sub_passes;
  photon_paths += other.photon_paths;
  photons_stored += other.photons_stored;
  rays += other.rays;
  faults += other.faults;
  return {};
}

}  // namespace pf
