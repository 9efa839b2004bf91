#include "jobs/benchmark/ablation.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <system_error>

#include <fmt/format.h>

#include "jobs/benchmark/material_terms.h"
#include "jobs/submission.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

/// A term that a key of the job decides; an empty key: there is none for that way.
struct KeyTerm {
  std::string_view name, off, on;
  std::string_view algorithms;  ///< that have the term; empty: all
};

constexpr std::string_view kMapMethods = "photon_map final_gather irradiance_cache";
constexpr std::array kKeyTerms = {
    KeyTerm{"caustic map", "photon_map.caustic_map=off", "photon_map.caustic_map=on", kMapMethods},
    KeyTerm{"projection map", "photon_map.projection_map=off", "photon_map.projection_map=on", kMapMethods},
    KeyTerm{"guided emission", "integrator.guide_emission=off", "integrator.guide_emission=on", "sppm ppm"},
    KeyTerm{"environment", "scene.environment_scale=0", "", ""},
    KeyTerm{"depth of field", "scene.lens_radius=0", "", ""},
};

/// The key that turns a term round; empty where none does.
std::string_view key_against(std::string_view term, bool on, const std::string& algorithm) {
  const auto* found = std::ranges::find(kKeyTerms, term, &KeyTerm::name);
  if (found == kKeyTerms.end()) return "";
  if (!found->algorithms.empty() && found->algorithms.find(algorithm) == std::string_view::npos) return "";
  return on ? found->off : found->on;
}

/// A copy of a scene whose materials are without a term.
Result<Scene> without(std::string_view term, const Scene& scene, const fs::path& out) {
  auto spec = load_job(scene.job, scene.set);
  if (!spec) return tl::unexpected(spec.error());
  std::string name(term);
  std::ranges::replace(name, ' ', '-');
  const fs::path folder = out / "ablations" / scene.name / name;
  std::vector<SubmittedFile> files;
  auto job = lay_out(*spec, folder, files);
  if (!job) return tl::unexpected(job.error());
  if (auto done = leave_out_of_materials(term, folder / spec->scene.file); !done) return tl::unexpected(done.error());
  Scene changed = scene;
  changed.job = *job;
  changed.hash += " without " + name;
  return changed;
}

/// A plan's decisions as the settings that make them again, whatever else changes.
MethodEntry as_planned(const nlohmann::json& decisions, const MethodEntry& method) {
  MethodEntry chosen = method;
  if (method.type != "auto") return chosen;
  for (const auto& decision : decisions) {
    const std::string subject = decision.value("subject", ""), choice = decision.value("choice", "");
    if (subject == "algorithm") chosen.type = choice;
    if (subject == "photons") chosen.set.push_back("integrator.photons=" + choice);
    if (subject == "light samples") chosen.set.push_back("integrator.light_samples=" + choice);
    if (subject == "guided emission") chosen.set.push_back("integrator.guide_emission=" + choice);
  }
  return chosen;
}

}  // namespace

Result<std::vector<Variant>> variants_of(const nlohmann::json& plan, const Scene& scene, const MethodEntry& method,
                                         const fs::path& out) {
  const nlohmann::json decisions = plan.value("/plan/decisions"_json_pointer, nlohmann::json::array());
  const MethodEntry chosen = as_planned(decisions, method);
  std::vector<Variant> variants = {{"", "", "", chosen, scene}};
  for (const auto& decision : decisions) {
    Variant variant{decision.value("subject", ""), decision.value("choice", ""), "", chosen, scene};
    const bool on = variant.planned == "on";
    if (const std::string_view key = key_against(variant.term, on, chosen.type); !key.empty()) {
      variant.instead = key;
      variant.method.set.push_back(variant.instead);
    } else if (on && is_material_term(variant.term)) {
      variant.instead = "out of the materials";
      auto changed = without(variant.term, scene, out);
      if (!changed) return tl::unexpected(changed.error());
      variant.scene = std::move(*changed);
    } else {
      continue;
    }
    variants.push_back(std::move(variant));
  }
  return variants;
}

void add_pair(Ablation& to, const ImageCost& planned, const ImageCost& other) {
  const double ratio = other.error / planned.error;
  to.lowest_ratio = to.seeds == 0 ? ratio : std::min(to.lowest_ratio, ratio);
  to.highest_ratio = to.seeds == 0 ? ratio : std::max(to.highest_ratio, ratio);
  to.error += planned.error;
  to.seconds += planned.seconds;
  to.error_ratio += other.error;
  to.seconds_ratio += other.seconds;
  ++to.seeds;
}

void finish(Ablation& ablation) {
  if (ablation.seeds == 0) return;
  ablation.error_ratio /= ablation.error;
  ablation.seconds_ratio /= ablation.seconds;
  ablation.error /= ablation.seeds;
  ablation.seconds /= ablation.seeds;
}

std::size_t ablation_budget(const Suite& suite) {
  const std::size_t budgets = std::max(suite.seconds.size(), suite.passes.size());
  return budgets < 2 ? 0 : budgets - 2;
}

}  // namespace pf::bench
