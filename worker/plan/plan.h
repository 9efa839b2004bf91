#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/base/result.h"
#include "common/spec/job_spec.h"
#include "worker/plan/scene_facts.h"

namespace pf {

/// One choice and why it was made, in words.
struct Decision {
  std::string subject;  ///< "algorithm", "caustic statistics", ...
  std::string choice;   ///< "sppm", "on", "off"
  std::string reason;
};

/// What is rendered how: an algorithm, and the terms that the scene needs. A term that is off costs nothing
/// and changes no bit of the image.
struct Plan {
  IntegratorType algorithm = IntegratorType::kPath;  ///< never kAuto
  bool caustic_statistics = false;                   ///< keep photons that came by a specular surface apart
  bool environment = false;
  bool textures = false;
  bool normal_maps = false;
  bool alpha = false;  ///< cut-out or blended surfaces
  bool rough_lobes = false;
  bool media = false;  ///< absorption inside glass
  bool depth_of_field = false;
  std::vector<Decision> decisions;  ///< the algorithm first, then each term in the order above
  std::vector<std::string> warnings;
};

/// Decides from the job and the scene alone; same input, same plan.
[[nodiscard]] Plan make_plan(const JobSpec& spec, const SceneFacts& facts);

/// What `photonfarm plan` prints: the job, the scene's facts, each decision with its reason.
[[nodiscard]] std::string plan_text(const JobSpec& spec, const SceneFacts& facts, const Plan& plan);
/// The same as one JSON object with the keys job, scene, plan.
[[nodiscard]] nlohmann::json plan_json(const JobSpec& spec, const SceneFacts& facts, const Plan& plan);
/// One line for an image's metadata: `sppm; caustic statistics on; ...`.
[[nodiscard]] std::string plan_line(const Plan& plan);

}  // namespace pf
