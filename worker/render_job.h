#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/result.h"
#include "common/film/render_result.h"
#include "common/spec/job_spec.h"
#include "worker/integrators/integrator.h"
#include "worker/photon/irradiance_parts.h"
#include "worker/plan/plan.h"
#include "worker/progress.h"
#include "worker/scene/scene.h"
#include "worker/snapshots.h"

namespace pf {

/// A job's scene file and environment, read and checked, the job's own lens and lights applied.
[[nodiscard]] Result<SceneDescription> load_scene_of_job(const JobSpec& spec);

/// Everything needed to render a job, built once.
struct LoadedJob {
  JobSpec spec;
  SceneFacts facts;
  Pilot pilot;
  double pilot_seconds = 0;
  Plan plan;
  std::string scene_hash;
  std::unique_ptr<const Scene> scene;
  const Camera* camera = nullptr;  ///< of the scene
  std::vector<ScenePart> parts;    ///< where a cache file asks what has changed
  std::unique_ptr<const Integrator> integrator;
  double load_seconds = 0;
  /// Of the scene and the plan.
  [[nodiscard]] std::vector<std::string> warnings() const;
};
/// All but the integrator: what `photonfarm plan` shows.
[[nodiscard]] Result<LoadedJob> plan_job(const JobSpec& spec, const Clock& clock);
[[nodiscard]] Result<LoadedJob> load_job_scene(const JobSpec& spec, const Clock& clock);

struct RenderRequest {
  JobSpec spec;
  std::filesystem::path out = ".";
  bool resume = false;
  int threads = 0;  ///< 0: all of the machine
  const std::atomic<bool>* interrupted = nullptr;
  SnapshotPlan snapshots = {};  ///< images written on the way, for photonfarm bench
};

/// Renders a job on this machine: rounds of sub-passes until the first stop condition, checkpoints on the way, then
/// EXR, PNG and JSON into `out`. Time limits are met on a sub-pass's border: no sub-pass is begun that would end too
/// late. Errors: of spec and scene; kInterrupted with a checkpoint left; kInternal for full disks and overflow.
[[nodiscard]] Result<RenderResult> render_job(const RenderRequest& request, const Clock& clock,
                                              const std::function<void(const Progress&)>& progress);

}  // namespace pf
