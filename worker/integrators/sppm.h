#pragma once

#include <utility>

#include "worker/integrators/progressive_mapping.h"

namespace pf {

/// Stochastic progressive photon mapping.
///
/// Hachisuka and Jensen 2009, "Stochastic Progressive Photon Mapping"; Knaus and Zwicker 2011, "Progressive Photon
/// Mapping: A Probabilistic Approach" (mode "independent"). A sub-pass traces photons, then one eye path per pixel to a
/// surface that scatters diffusely or roughly, and gathers there within the pixel's radius; direct light is sampled
/// from the eye, by more paths where it varies, photons bring the rest. Radii shrink with the photons found, so that
/// bias and variance both vanish: squared error falls as N^(-2/3) at alpha = 2/3.
/// Biased at any finite time: illumination is blurred over the radius. Where it fails: scenes of which the eye sees a
/// small part, which most photons never reach.
class SppmIntegrator final : public ProgressiveMapping {
 public:
  SppmIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec, EmissionGuide guide = {})
      : ProgressiveMapping(scene, camera, spec, EyeSampling{}, std::move(guide)) {}
};

}  // namespace pf
