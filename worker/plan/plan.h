#pragma once

#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/base/result.h"
#include "common/spec/job_spec.h"
#include "worker/plan/forecast.h"
#include "worker/plan/pilot.h"
#include "worker/plan/scene_facts.h"

namespace pf {

/// One choice and why it was made, in words.
struct Decision {
  std::string subject;  ///< "algorithm", "caustic map", ...
  std::string choice;   ///< "sppm", "on", "off"
  std::string reason;
};

/// What a method would cost, as the pilot foretells it.
struct Candidate {
  IntegratorType method = IntegratorType::kPath;
  Forecast forecast;
};

/// What is rendered how: an algorithm, and the terms that the scene needs. A term that is off costs nothing
/// and changes no bit of the image.
struct Plan {
  IntegratorType algorithm = IntegratorType::kPath;  ///< never kAuto
  std::int64_t photons = 0;                          ///< paths of a sub-pass; 0: as the job has it
  int light_samples = 1;                             ///< of direct light at a point that the eye sees
  bool caustic_map = false;                          ///< some photon meets a mirror or glass first
  bool projection_map = false;                       ///< photons only towards what the lights see
  bool guided_emission = false;                      ///< photons start where Pilot::emission says
  bool environment = false;
  bool textures = false;
  bool normal_maps = false;
  bool alpha = false;  ///< cut-out or blended surfaces
  bool rough_lobes = false;
  bool media = false;  ///< absorption inside glass
  bool depth_of_field = false;
  std::vector<Decision> decisions;  ///< the algorithm first, then photons, light samples, each term in the order above
  std::vector<Candidate> candidates;  ///< the methods that `auto` weighs, in order of their work to kPlanTarget
  std::vector<std::string> warnings;

  /// The forecast of the algorithm, where there is one.
  [[nodiscard]] const Forecast* forecast() const;
  /// The job with what it left open decided: what methods are made from.
  [[nodiscard]] JobSpec resolve(const JobSpec& spec) const;
};

/// Decides from the job, the scene and its pilot alone; same input, same plan. What the job says outright is
/// kept. Never looks at stop: a job that is made longer keeps its plan.
[[nodiscard]] Plan make_plan(const JobSpec& spec, const SceneFacts& facts, const Pilot& pilot);

/// What `photonfarm plan` prints beside the plan: how fast this machine is.
struct PilotTiming {
  double seconds = 0;  ///< of the pilot, all threads
  /// Seconds of one unit of Forecast's work, as the pilot found it.
  [[nodiscard]] double per_work(const Pilot& pilot) const;
};

/// What `photonfarm plan` prints: the job, the scene's facts, the pilot's evidence, each decision with its
/// reason, and when the image would reach stop.error, or kPlanTarget without one.
[[nodiscard]] std::string plan_text(const JobSpec& spec, const SceneFacts& facts, const Pilot& pilot, const Plan& plan,
                                    const PilotTiming& timing);
/// The same as one JSON object with the keys job, scene, pilot, plan, forecast.
[[nodiscard]] nlohmann::json plan_json(const JobSpec& spec, const SceneFacts& facts, const Pilot& pilot,
                                       const Plan& plan, const PilotTiming& timing);
/// One line for an image's metadata: `sppm; caustic map on; ...`.
[[nodiscard]] std::string plan_line(const Plan& plan);

}  // namespace pf
