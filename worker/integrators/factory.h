#pragma once

#include <memory>
#include <vector>

#include "common/spec/job_spec.h"
#include "worker/integrators/integrator.h"
#include "worker/photon/emission_guide.h"
#include "worker/photon/irradiance_parts.h"
#include "worker/scene/scene.h"

namespace pf {

/// The algorithm `type` (not kAuto: the planner has chosen by now) over a scene, which outlives it. Structures that the
/// method reads are made here, on the threads of the calling arena. `guide`: of ppm's and sppm's photons.
[[nodiscard]] std::unique_ptr<const Integrator> make_integrator(IntegratorType type, const Scene& scene,
                                                                const Camera& camera, const JobSpec& spec,
                                                                std::vector<ScenePart> parts = {},
                                                                EmissionGuide guide = {});

}  // namespace pf
