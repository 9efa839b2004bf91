#pragma once

#include <array>
#include <mutex>
#include <optional>

#include "common/spec/job_spec.h"
#include "worker/integrators/eye.h"
#include "worker/integrators/eye_allocation.h"
#include "worker/integrators/first_radius.h"
#include "worker/integrators/integrator.h"
#include "worker/photon/emission_guide.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/photon_tree.h"

namespace pf {

/// What progressive photon mapping and its stochastic form have in common: photons traced per sub-pass, eye paths to
/// surfaces that scatter, gathers there within radii that shrink from round to round (or by a preset rule in mode
/// "independent"). They differ in where the eye looks (EyeSampling).
///
/// Beyond the papers:
/// - caustic and indirect photons keep separate statistics: a narrow radius for edges, a wide one for smooth light;
/// - first discs are twice as large where light changes evenly and the surface reaches so far (first_radius.h);
/// - the disc's area counts only where there is surface (covered_area.h), so that wide radii do not darken corners;
/// - the first smooth boundaries split the eye path in two, so that a weak reflection of a lamp is no rare event;
/// - pixels in which direct light varies take several samples of it a sub-pass and average them (eye_allocation.h);
/// - photons start where it matters, by a guide that a pilot taught (guided_emission.h); without one, by flux;
/// - rough reflections are gathered or followed by a share that is smooth in roughness (Bsdf::gather_share).
class ProgressiveMapping : public Integrator {
 public:
  [[nodiscard]] FilmOptions film_options() const override { return film_; }
  [[nodiscard]] std::vector<ProgressivePixel> initial_radii() const override;
  void run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const override;

 protected:
  /// Where the eye looks.
  struct EyeSampling {
    /// Eye samples that every sub-pass traces again, the same each time; 0: new ones each, as EyeAllocation says.
    std::uint64_t fixed = 0;
    int hit_points = 1;  ///< statistics of a pixel; a pixel with more hit points lets the last ones share
  };
  ProgressiveMapping(const Scene& scene, const Camera& camera, const JobSpec& spec, const EyeSampling& sampling,
                     EmissionGuide guide);

 private:
  using Trees = std::array<PhotonTree, kFlows>;
  using Cursors = std::array<GatherCursor, kFlows>;

  [[nodiscard]] std::size_t points() const { return static_cast<std::size_t>(sampling_.hit_points); }
  /// The eye samples [first, first + count) of a pixel in a sub-pass.
  struct EyeSamples {
    std::uint64_t first, count;
  };
  [[nodiscard]] EyeSamples eye_samples(std::size_t pixel, std::uint64_t sub_pass) const;
  [[nodiscard]] Trees build_trees(PhotonBatch batch) const;
  struct FirstDisc;
  struct RadiusSink;
  struct RadianceSink;
  /// One pixel's eye samples of a sub-pass, whose photons `photons` asks.
  void gather_pixel(int x, int y, std::uint64_t sub_pass, const std::vector<ProgressivePixel>& state, Cursors& photons,
                    Statistics& sums, TileFigures& figures) const;
  void fill_missing_radii(std::vector<ProgressivePixel>& state) const;

  const Scene& scene_;
  EyeSampling sampling_;
  Eye eye_;
  EmissionGuide guide_;
  PhotonTracer tracer_;
  FirstRadius first_radius_;
  FilmOptions film_;
  int max_depth_;
  int light_samples_;
  /// Made by the first unit: who only looks at radii needs none.
  mutable std::once_flag allocating_;
  mutable std::optional<EyeAllocation> allocation_;
};

}  // namespace pf
