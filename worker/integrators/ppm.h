#pragma once

#include "worker/integrators/progressive_mapping.h"

namespace pf {

/// Progressive photon mapping.
///
/// Hachisuka, Ogaki and Jensen 2008, "Progressive Photon Mapping". Eye paths are chosen once: a fixed number of samples
/// for each pixel, split at smooth boundaries, so that a pixel has several hit points. Each keeps its own radius R,
/// photon count N and flux tau; photon passes follow one another, and between rounds of them radius reduction (7), flux
/// correction (9) and radiance evaluation (10) are applied (common/film/progressive.h). Direct light is sampled from
/// the eye at the same hit points, with new light samples each pass. Biased at any finite time, consistent for the
/// image of these eye samples. Where it fails: depth of field, glossy reflections and fine edges, whose eye samples
/// never become more (SPPM was made for them); memory grows with the hit points.
///
/// Eye paths are not stored but traced again, bit for bit the same: the paper's hit points, at 132 bytes of statistics
/// each.
class PpmIntegrator final : public ProgressiveMapping {
 public:
  PpmIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec, EmissionGuide guide = {});
};

}  // namespace pf
