#pragma once

#include <cstdint>

#include "common/spec/job_spec.h"
#include "worker/plan/pilot.h"

namespace pf {

/// How a method's error falls and what it costs, as the pilot foretells it. The model, held against
/// measurement in tests/bench/PLANNER.md: relMSE after n passes = fast / n^power + slow / n^(2/3) + floor,
/// and work = setup + n * pass.
struct Forecast {
  double fast = 0;   ///< noise that independent samples average out
  double power = 1;  ///< above 1 where samples are stratified over passes
  double slow = 0;   ///< noise and blur of photons within shrinking radii
  double floor = 0;  ///< what never goes away
  double setup = 0;  ///< work before the first pass [unit: an eye ray of a path tracer, with its shading]
  double pass = 0;   ///< work of a pass [same]

  [[nodiscard]] double error(double passes) const;
  /// Least passes after which the error is at most `target`; infinite when it never is.
  [[nodiscard]] double passes_to(double target) const;
  [[nodiscard]] double work_to(double target) const;
};

/// The error that methods are compared at. Not the job's stop.error: a job that is made longer keeps its
/// method.
inline constexpr double kPlanTarget = 0.01;
/// Around kPlanTarget the forecast of an error is right within this factor both ways on the example scenes.
inline constexpr double kForecastFactor = 3.0;

/// Whether photons of ppm and sppm are to start where the pilot learned that it matters: where that leaves at most two
/// thirds of their noise and sppm comes to kPlanTarget a tenth sooner by it, or where the job says so.
[[nodiscard]] bool guides_emission(const JobSpec& spec, const Pilot& pilot);
[[nodiscard]] Forecast forecast_path(const JobSpec& spec, const Pilot& pilot);
/// Of sppm with its photon paths of a pass as the job says or, where it leaves them open, plan_photons().
[[nodiscard]] Forecast forecast_sppm(const JobSpec& spec, const Pilot& pilot);
/// Photon paths of a pass of sppm: the job's, or those of 1, 2, 4 ... 32 a pixel with the least work to
/// kPlanTarget. Few where the eye's own noise rules, many where few photons reach what is seen.
[[nodiscard]] std::int64_t plan_photons(const JobSpec& spec, const Pilot& pilot);
[[nodiscard]] Forecast forecast_irradiance_cache(const JobSpec& spec, const Pilot& pilot);

}  // namespace pf
