#pragma once

#include "common/spec/job_spec.h"
#include "worker/integrators/eye.h"
#include "worker/integrators/integrator.h"

namespace pf {

/// Path tracing: the reference for everything else.
///
/// Kajiya 1986, "The Rendering Equation"; Veach 1997, "Robust Monte Carlo Methods for Light Transport Simulation",
/// chapter 9. Estimates the full light transport without bias: at every vertex one light sample over all lights,
/// weighed against the BSDF's own direction by the power heuristic; Russian roulette on the path's throughput. Where it
/// fails: caustics of small lamps are found by chance only, those of point and directional lights never.
///
/// A sub-pass is one sample per pixel.
class PathIntegrator final : public Integrator {
 public:
  PathIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec);
  [[nodiscard]] FilmOptions film_options() const override { return film_; }
  [[nodiscard]] std::vector<ProgressivePixel> initial_radii() const override { return {}; }
  void run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const override;
  /// Adds one sample of one pixel; `features` may be null.
  void trace(int x, int y, std::uint64_t sample, PixelSums& sums, FeatureSums* features, TileFigures& figures) const;

 private:
  const Scene& scene_;
  Eye eye_;
  FilmOptions film_;
  int max_depth_;
};

}  // namespace pf
