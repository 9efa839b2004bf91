#pragma once

#include <array>

#include "common/spec/job_spec.h"
#include "worker/integrators/eye.h"
#include "worker/integrators/integrator.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/photon_tree.h"

namespace pf {

/// Stochastic progressive photon mapping.
///
/// Hachisuka and Jensen 2009, "Stochastic Progressive Photon Mapping"; Knaus and Zwicker 2011, "Progressive Photon
/// Mapping: A Probabilistic Approach" (mode "independent"). A sub-pass traces photons, then one eye path per pixel to a
/// surface that scatters diffusely or roughly, and gathers there within the pixel's radius; direct light is sampled
/// from the eye, photons bring the rest. Radii shrink with the photons found, so that bias and variance both vanish:
/// squared error falls as N^(-2/3) at alpha = 2/3.
/// Biased at any finite time: illumination is blurred over the radius. Where it fails: scenes of which the eye sees a
/// small part, which most photons never reach.
///
/// Beyond the papers:
/// - caustic and indirect photons keep separate statistics: a narrow radius for edges, a wide one for smooth light;
/// - the disc's area counts only where there is surface (covered_area.h), so that wide radii do not darken corners;
/// - the first smooth boundaries split the eye path in two, so that a weak reflection of a lamp is no rare event;
/// - rough reflections are gathered or followed by a share that is smooth in roughness (Bsdf::gather_share).
class SppmIntegrator final : public Integrator {
 public:
  SppmIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec);
  [[nodiscard]] FilmOptions film_options() const override { return film_; }
  [[nodiscard]] std::vector<ProgressivePixel> initial_radii() const override;
  void run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const override;

 private:
  using Trees = std::array<PhotonTree, kFlows>;

  [[nodiscard]] Trees build_trees(PhotonBatch batch) const;
  struct RadiusSink;
  struct RadianceSink;
  [[nodiscard]] float first_radius2(const PhotonTree& tree, Flow flow, const Vertex& vertex, float footprint) const;
  void fill_missing_radii(std::vector<ProgressivePixel>& state) const;

  const Scene& scene_;
  Eye eye_;
  PhotonTracer tracer_;
  FilmOptions film_;
  double fixed_radius_;
  float scene_radius_;       ///< half the diagonal of the scene's bounds [m]
  int max_depth_;
};

}  // namespace pf
