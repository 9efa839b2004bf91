#include "worker/integrators/factory.h"

#include <utility>

#include "worker/integrators/final_gather.h"
#include "worker/integrators/irradiance_cache.h"
#include "worker/integrators/path.h"
#include "worker/integrators/photon_map.h"
#include "worker/integrators/photon_splat.h"
#include "worker/integrators/ppm.h"
#include "worker/integrators/sppm.h"

namespace pf {

std::unique_ptr<const Integrator> make_integrator(IntegratorType type, const Scene& scene, const Camera& camera,
                                                  const JobSpec& spec, std::vector<ScenePart> parts,
                                                  EmissionGuide guide) {
  switch (type) {
    case IntegratorType::kPath:
      return std::make_unique<PathIntegrator>(scene, camera, spec);
    case IntegratorType::kPhotonMap:
      return std::make_unique<PhotonMapIntegrator>(scene, camera, spec);
    case IntegratorType::kFinalGather:
      return std::make_unique<FinalGatherIntegrator>(scene, camera, spec);
    case IntegratorType::kIrradianceCache:
      return std::make_unique<IrradianceCacheIntegrator>(scene, camera, spec, std::move(parts));
    case IntegratorType::kPhotonSplat:
      return std::make_unique<PhotonSplatIntegrator>(scene, camera, spec);
    case IntegratorType::kPpm:
      return std::make_unique<PpmIntegrator>(scene, camera, spec, std::move(guide));
    default:
      return std::make_unique<SppmIntegrator>(scene, camera, spec, std::move(guide));
  }
}

}  // namespace pf
