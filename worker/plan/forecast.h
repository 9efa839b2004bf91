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
  /// What methods are chosen by: geometric mean of the work to kPlanTarget and to kFineTarget.
  [[nodiscard]] double judged_work() const;
};

/// Errors that methods are compared at: a first good look, and an image that is kept. Not the job's stop.error: a job
/// that is made longer keeps its method.
inline constexpr double kPlanTarget = 0.01, kFineTarget = 0.001;
/// Around kPlanTarget the forecast of an error is right within this factor both ways on the example scenes.
inline constexpr double kForecastFactor = 3.0;

/// What a pass of sppm does.
struct SppmChoice {
  std::int64_t photons = 0;  ///< paths
  int light_samples = 1;     ///< of direct light at a point that the eye sees
  bool guided = false;       ///< photons start where the pilot learned that it matters
};
/// The job's, or 4 photon paths a pixel and of 1, 2 or 4 samples of direct light what takes the least work to
/// kFineTarget, the fewest of those within 3 %; guided where the pilot's guide is foretold to save a sixth of that
/// work.
[[nodiscard]] SppmChoice plan_sppm(const JobSpec& spec, const Pilot& pilot);
/// Whether a guide could save a sixth of the work to kFineTarget if it left no noise of photons at all, lessons
/// included, and these are short against the work to a first good look; or the job asks for one.
[[nodiscard]] bool guide_could_pay(const JobSpec& spec, const Pilot& pilot);
[[nodiscard]] Forecast forecast_path(const JobSpec& spec, const Pilot& pilot);
/// With plan_sppm().
[[nodiscard]] Forecast forecast_sppm(const JobSpec& spec, const Pilot& pilot);
/// Samples of direct light at a point that the eye sees: one for path tracing, those of plan_sppm() for sppm and ppm,
/// for other methods the job's, or of 1, 2, 4 and 8 the fewest that take no more than 3 % over the least of the work
/// that the eye's noise takes.
[[nodiscard]] int plan_light_samples(const JobSpec& spec, const Pilot& pilot, IntegratorType method);
[[nodiscard]] Forecast forecast_irradiance_cache(const JobSpec& spec, const Pilot& pilot);

}  // namespace pf
