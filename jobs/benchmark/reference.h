#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/math/vec.h"
#include "jobs/benchmark/runner.h"
#include "jobs/benchmark/schedule.h"

namespace pf::bench {

/// An image to measure errors against, with its own confidence.
struct Reference {
  std::string id;       ///< scene, job and seeds; the folder's name in the cache
  std::string error;    ///< why there is none; empty: there is one
  std::string type;     ///< integrator.type
  bool biased = false;  ///< anything but path: both halves share its bias, which `noise` does not show
  int width = 0, height = 0;
  std::vector<Rgb> mean;           ///< of both halves
  std::vector<Rgb> variance;       ///< estimated, of `mean`, per pixel and channel
  std::uint64_t passes = 0;        ///< of each half
  double seconds = 0;              ///< rendering, both halves
  double noise = 0;                ///< relMSE of `mean` that is its own noise
  double flip_between_halves = 0;  ///< HDR-FLIP of one half against the other

  /// Changes with everything that errors measured against it depend on.
  [[nodiscard]] std::string key() const;
};

/// Finds a scene's reference in `cache`, makes it, or renders on until it is as good as the suite asks. Passes of a
/// reference that was interrupted are kept. What goes wrong in rendering is the reference's `error`; errors are
/// kInterrupted, kUnavailable, kInternal (the disk) and kInvalidSpec (keys of the suite). `progress(seconds, passes,
/// noise)`: while it renders; noise 0 until both halves exist.
using ReferenceProgress = std::function<void(double seconds, std::uint64_t passes, double noise)>;
[[nodiscard]] Result<Reference> ensure_reference(const Scene& scene, const std::filesystem::path& cache, int threads,
                                                 Runner& runner, const ReferenceProgress& progress);

/// The beauty of an EXR of this size. Errors: kInvalidInput.
struct Beauty {
  int width = 0, height = 0;
  std::vector<Rgb> pixels;
};
[[nodiscard]] Result<Beauty> read_beauty(const std::filesystem::path& file);

}  // namespace pf::bench
