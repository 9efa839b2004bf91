#pragma once

#include <cstdint>

#include "common/spec/job_spec.h"
#include "worker/integrators/gather_points.h"
#include "worker/integrators/gather_rays.h"
#include "worker/integrators/photon_map.h"
#include "worker/integrators/single_pass.h"

namespace pf {

/// Photon mapping with a final gather.
///
/// Jensen 1996, "Global Illumination using Photon Maps"; Christensen 1999, "Faster Photon Map Global
/// Illumination". As photon_map, but indirect light is gathered by rays over the hemisphere of what the eye
/// sees, and the global map, which holds all light, is looked up where those rays end: its blotches are
/// averaged out. Caustics come from a caustic map.
///
/// Irradiance on Lambert reflectors that the eye sees directly is gathered at points placed adaptively over
/// the image (GatherPoints) and interpolated between them; elsewhere each sample gathers a part of the rays.
/// Rough reflections gather a few rays along their lobe. With final_gather.error 0 every sample gathers all
/// rays.
///
/// Biased by the blur of the map at the rays' ends, which gathering averages, by the interpolation, and by
/// the caustic map. Where it fails: corners, where rays end so near that the map's blur shows; irradiance
/// that changes within less than a gather point's strata can see.
class FinalGatherIntegrator final : public SinglePassIntegrator {
 public:
  FinalGatherIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec);

 protected:
  void render(const PixelTarget& target) const override;
  void prepare(const ImagePart& part) const override;

 private:
  struct Gather;

  int rays_;
  bool interpolate_;
  std::uint64_t seed_;
  MapGather map_;
  HemisphereGather hemisphere_;
  MapEstimate caustics_;
  TileFigures photon_figures_;  ///< of the maps; counted with the first pixel's first sample
  mutable CoveredRadii covered_;
  mutable GatherPoints points_;
};

}  // namespace pf
