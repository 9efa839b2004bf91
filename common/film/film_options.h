#pragma once

#include <cstdint>

#include "common/film/statistics.h"

namespace pf {

/// How pixel sums become radiance.
enum class Estimator : std::uint8_t {
  kPath,        ///< mean of radiance samples
  kShared,      ///< progressive photon mapping, radii shared by the sub-passes of a round
  kIndependent  ///< photon mapping averaged over sub-passes of shrinking, preset radii
};

struct FilmOptions {
  int width = 0;
  int height = 0;
  Estimator estimator = Estimator::kPath;
  SumScale scale;
  double alpha = 2.0 / 3.0;
  double round_growth = 0.25;
  Extra extra = Extra::kNone;
  int part_edge = 0;   ///< pixels; a sub-pass covers one tile of this edge (PassOrder); 0: the whole image
  int hit_points = 1;  ///< statistics that every pixel keeps (ppm); those of pixel i are hit_points * i and following
};

}  // namespace pf
