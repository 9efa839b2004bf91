#pragma once

#include <array>

#include "common/spec/job_spec.h"
#include "worker/integrators/eye.h"
#include "worker/integrators/integrator.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/photon_tree.h"

namespace pf {

/// What progressive photon mapping and its stochastic form have in common: photons traced per sub-pass, eye paths to surfaces that
/// scatter, gathers there within radii that shrink from round to round (or by a preset rule in mode "independent"). They differ
/// in where the eye looks (EyeSampling).
///
/// Beyond the papers:
/// - caustic and indirect photons keep separate statistics: a narrow radius for edges, a wide one for smooth light;
/// - the disc's area counts only where there is surface (covered_area.h), so that wide radii do not darken corners;
/// - the first smooth boundaries split the eye path in two, so that a weak reflection of a lamp is no rare event;
/// - rough reflections are gathered or followed by a share that is smooth in roughness (Bsdf::gather_share).
class ProgressiveMapping : public Integrator {
 public:
  [[nodiscard]] FilmOptions film_options() const override { return film_; }
  [[nodiscard]] std::vector<ProgressivePixel> initial_radii() const override;
  void run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const override;

 protected:
  /// Where the eye looks.
  struct EyeSampling {
    std::uint64_t fixed = 0;  ///< eye samples that every sub-pass traces again, the same each time; 0: one new sample each
    int hit_points = 1;       ///< statistics of a pixel; a pixel with more hit points lets the last ones share
  };
  ProgressiveMapping(const Scene& scene, const Camera& camera, const JobSpec& spec, const EyeSampling& sampling);

 private:
  using Trees = std::array<PhotonTree, kFlows>;

  [[nodiscard]] std::size_t points() const { return static_cast<std::size_t>(sampling_.hit_points); }
  /// Calls `visit` with the eye samples of a sub-pass.
  template <typename Visit>
  void for_each_eye_sample(std::uint64_t sub_pass, Visit&& visit) const {
    if (sampling_.fixed == 0) return visit(sub_pass);
    for (std::uint64_t sample = 0; sample < sampling_.fixed; ++sample) visit(sample);
  }
  [[nodiscard]] Trees build_trees(PhotonBatch batch) const;
  struct RadiusSink;
  struct RadianceSink;
  [[nodiscard]] float first_radius2(const PhotonTree& tree, Flow flow, const Vertex& vertex, float footprint) const;
  void fill_missing_radii(std::vector<ProgressivePixel>& state) const;

  const Scene& scene_;
  EyeSampling sampling_;
  Eye eye_;
  PhotonTracer tracer_;
  FilmOptions film_;
  double fixed_radius_;
  float scene_radius_;       ///< half the diagonal of the scene's bounds [m]
  int max_depth_;
};

}  // namespace pf
