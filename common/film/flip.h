#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/math/vec.h"

namespace pf {

/// FLIP: the difference that a person sees when two images alternate at the same place.
///
/// [Andersson20] Andersson, Nilsson, Akenine-Moeller, Oskarsson, Astroem, Fairchild: "FLIP: A Difference
/// Evaluator for Alternating Images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), 2020.
///
/// [Andersson21] Andersson, Nilsson, Shirley, Akenine-Moeller: "Visualizing Errors in Rendered High Dynamic
/// Range Images", Eurographics 2021 short papers.
///
/// Errors are in [0, 1] per pixel, 0 where the images are equal. Images are row by row, `width` x `height`
/// pixels, linear Rec.709 and finite. The order of the two images matters only to HDR-FLIP's range of
/// exposures, which the reference decides.

/// A 0.7 m wide screen of 3840 pixels seen from 0.7 m, the default of [Andersson20]: 67.02 pixels per
/// degree.
inline constexpr float kPixelsPerDegree = 0.7f * (3840.0f / 0.7f) * (kPi / 180.0f);

struct FlipMap {
  std::vector<float> error;  ///< per pixel
  double mean = 0.0;
};

/// LDR-FLIP of images whose channels are clamped to [0, 1] first.
[[nodiscard]] FlipMap ldr_flip(std::span<const Rgb> image, std::span<const Rgb> reference, int width, int height,
                               float pixels_per_degree = kPixelsPerDegree);

struct HdrFlipMap : FlipMap {
  float start_exposure = 0.0f;  ///< stops; brightest pixel of the reference just below white
  float stop_exposure = 0.0f;   ///< stops; median pixel of the reference just below white
  int exposures = 0;            ///< evenly spaced between the two, about one a stop
};

/// HDR-FLIP: per pixel the largest LDR-FLIP over exposures that show all of the reference, ACES tone-mapped.
/// Negative values count as 0. Time and memory grow with pixels; time also with the number of exposures.
[[nodiscard]] HdrFlipMap hdr_flip(std::span<const Rgb> image, std::span<const Rgb> reference, int width, int height,
                                  float pixels_per_degree = kPixelsPerDegree);

/// Colours for a FLIP map: sRGB bytes, three a pixel, of the magma map from black (0) over red to pale yellow
/// (1).
[[nodiscard]] std::vector<std::uint8_t> magma_colors(std::span<const float> error);

}  // namespace pf
