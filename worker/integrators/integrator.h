#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/film/film.h"
#include "common/film/progressive.h"
#include "common/film/statistics.h"

namespace pf {

/// What a worker takes: consecutive sub-passes of one round.
struct WorkUnit {
  std::uint64_t first_sub_pass = 0;
  std::uint64_t sub_passes = 1;
};

/// An algorithm that renders in sub-passes whose sums are exact. The single node and the farm run this same code; they
/// only decide where and in which order units run.
class Integrator {
 public:
  virtual ~Integrator() = default;

  /// Size, estimator and fixed-point steps of the film that the results add up to.
  [[nodiscard]] virtual FilmOptions film_options() const = 0;
  /// Radii that the first round starts with, from sub-pass 0 alone; empty when the algorithm has none.
  [[nodiscard]] virtual std::vector<ProgressivePixel> initial_radii() const = 0;
  /// What a user should know of how the structures were made.
  [[nodiscard]] virtual std::vector<std::string> warnings() const { return {}; }
  /// Adds the unit's sub-passes to `sums`. `state`: radii at the start of the unit's round. Uses the threads of the
  /// calling arena; the sums do not depend on how many there are.
  virtual void run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const = 0;
};

}  // namespace pf
