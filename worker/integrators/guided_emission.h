#pragma once

#include <cstdint>

#include "common/spec/job_spec.h"
#include "worker/integrators/eye.h"
#include "worker/photon/emission_guide.h"

namespace pf {

inline constexpr int kEmissionLessons = 4, kEmissionPixels = 4096;
inline constexpr std::int64_t kMostLessonPaths = 32768;

/// What a pilot taught about emission.
struct LearnedEmission {
  EmissionGuide guide;
  /// Summed squared contributions of uniform emission over those of guided emission, at equal paths: how much less
  /// noise photons bring. Of the last lesson, by the guide that it did not learn from yet.
  double gain = 1.0;
  std::uint32_t paths = 0;     ///< traced
  double rays_per_path = 0.0;  ///< of the last lesson
};

/// Learns where photon paths start that matter to the image: a path is worth the sum of its squared contributions to
/// pixels, by progressive photon mapping's first discs, over the pixels' squared radiance. Lesson after lesson, each
/// guided by the ones before.
///
/// A function of scene, camera, image size, depth and photons of a sub-pass: random numbers are fixed, whatever the
/// job's seed, sums are taken in a fixed order, so that every worker of a farm learns the same on any number of
/// threads. The pilot's photons are not used for the image.
/// It gives kEmissionLessons lessons at most, of as many paths as of a sub-pass and no more than kMostLessonPaths, and
/// looks at kEmissionPixels pixels of a grid over the image.
[[nodiscard]] LearnedEmission learn_emission(const Scene& scene, const Camera& camera, const JobSpec& spec);

}  // namespace pf
