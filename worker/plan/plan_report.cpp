#include <iterator>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "worker/plan/plan.h"

namespace pf {
namespace {

using Words = std::vector<std::string>;

/// `3 glass`; nothing for zero, so that a list names only what is there.
void add_count(Words& words, std::int64_t n, std::string_view name) {
  if (n != 0) words.push_back(fmt::format("{} {}", n, name));
}

std::string listed(const Words& words, std::string_view none) {
  return words.empty() ? std::string(none) : fmt::format("{}", fmt::join(words, ", "));
}

std::string material_words(const MaterialCounts& m) {
  Words words;
  add_count(words, m.diffuse, "diffuse");
  add_count(words, m.glossy, "glossy");
  add_count(words, m.metal, "metal");
  add_count(words, m.glass, "glass");
  add_count(words, m.thin_glass, "thin glass");
  add_count(words, m.unlit, "unlit");
  Words extras;
  add_count(extras, m.emissive, "emissive");
  add_count(extras, m.clearcoat, "with clearcoat");
  add_count(extras, m.sheen, "with sheen");
  add_count(extras, m.alpha_mask, "cut out");
  add_count(extras, m.alpha_blend, "blended");
  const std::string kinds = listed(words, "none in use");
  return extras.empty() ? kinds : fmt::format("{}; of these {}", kinds, fmt::join(extras, ", "));
}

std::string light_words(const LightCounts& lights) {
  Words words;
  const auto add = [&](std::int64_t n, std::string_view one, std::string_view many, double flux) {
    if (n > 0) words.push_back(fmt::format("{} {} ({:.4g} W)", n, n == 1 ? one : many, flux));
  };
  add(lights.points, "point light", "point lights", lights.point_flux);
  add(lights.spots, "spot light", "spot lights", lights.spot_flux);
  add(lights.directional, "directional light", "directional lights", lights.directional_flux);
  add(lights.emissive_triangles, "emissive triangle", "emissive triangles", lights.emissive_flux);
  if (lights.environment_map) {
    words.emplace_back("an environment map");
  } else if (lights.environment) {
    words.push_back(fmt::format("a constant environment ({:.4g} W)", lights.environment_flux));
  }
  return listed(words, "none");
}

std::string length_words(const JobSpec& spec, const Plan& plan) {
  const bool photons = plan.algorithm == IntegratorType::kSppm;
  Words words;
  if (spec.stop.passes > 0) {
    words.push_back(
        photons ? fmt::format("{} passes of {} photon paths", spec.stop.passes, spec.integrator.photons)
                : fmt::format("{} samples a pixel", spec.stop.passes));
  }
  if (spec.stop.seconds > 0) words.push_back(fmt::format("{:g} s", spec.stop.seconds));
  if (spec.stop.error > 0) words.push_back(fmt::format("a relative error of {:g}", spec.stop.error));
  if (words.empty()) return "runs until it is interrupted";
  return fmt::format("stops at {}", fmt::join(words, " or "));
}

std::string camera_words(const JobSpec& spec, const SceneFacts& facts) {
  const std::string name =
      spec.scene.camera.empty() && !facts.cameras.empty() ? facts.cameras.front() : spec.scene.camera;
  return name.empty() ? "the first camera" : fmt::format("camera \"{}\"", name);
}

nlohmann::json bounds_json(const Box3f& box) {
  if (box.isEmpty()) return nullptr;
  return {{"min", {box.min.x, box.min.y, box.min.z}}, {"max", {box.max.x, box.max.y, box.max.z}}};
}

nlohmann::json facts_json(const SceneFacts& facts) {
  const MaterialCounts& m = facts.materials;
  const LightCounts& l = facts.lights;
  const CausticFacts& c = facts.caustics;
  nlohmann::json environment_flux = nullptr;
  if (!l.environment_map) environment_flux = l.environment_flux;
  return {
      {"triangles", facts.triangles},
      {"triangles_placed", facts.triangles_placed},
      {"meshes", facts.meshes},
      {"instances", facts.instances},
      {"instanced_meshes", facts.instanced_meshes},
      {"materials",
       {{"diffuse", m.diffuse},
        {"glossy", m.glossy},
        {"metal", m.metal},
        {"glass", m.glass},
        {"thin_glass", m.thin_glass},
        {"unlit", m.unlit},
        {"clearcoat", m.clearcoat},
        {"sheen", m.sheen},
        {"emissive", m.emissive},
        {"alpha_mask", m.alpha_mask},
        {"alpha_blend", m.alpha_blend}}},
      {"lights",
       {{"points", l.points},
        {"spots", l.spots},
        {"directional", l.directional},
        {"emissive_triangles", l.emissive_triangles},
        {"environment", l.environment},
        {"environment_map", l.environment_map},
        {"point_flux_watts", l.point_flux},
        {"spot_flux_watts", l.spot_flux},
        {"directional_flux_watts", l.directional_flux},
        {"emissive_flux_watts", l.emissive_flux},
        {"environment_flux_watts", environment_flux}}},
      {"caustics",
       {{"casters", c.casters},
        {"reached_by_small_lights", c.reached_by_small},
        {"reached_by_large_lights", c.reached_by_large},
        {"smallest_light_share", c.smallest_light},
        {"materials", c.names},
        {"lights_in_glass", c.lights_in_glass}}},
      {"textures", facts.textures},
      {"normal_maps", facts.normal_maps},
      {"rough_lobes", facts.rough_lobes},
      {"absorbing_media", facts.media},
      {"cameras", facts.cameras},
      {"bounds_metres", bounds_json(facts.bounds)},
  };
}

}  // namespace

std::string plan_text(const JobSpec& spec, const SceneFacts& facts, const Plan& plan) {
  std::string text;
  const auto line = [&]<typename... Args>(fmt::format_string<Args...> format, Args&&... args) {
    fmt::format_to(std::back_inserter(text), format, std::forward<Args>(args)...);
    text += '\n';
  };
  line("{}: {}", spec.job.name, to_string(plan.algorithm));
  line("  {} x {} pixels, {}, {}", spec.image.width, spec.image.height, camera_words(spec, facts),
       length_words(spec, plan));
  line("scene");
  line("  {:<20}{} in {} meshes; {} as placed by {} instances", "triangles", facts.triangles, facts.meshes,
       facts.triangles_placed, facts.instances);
  if (!facts.bounds.isEmpty()) {
    const Vec3f size = facts.bounds.size();
    line("  {:<20}{:.4g} x {:.4g} x {:.4g} m", "size", size.x, size.y, size.z);
  }
  line("  {:<20}{}", "materials", material_words(facts.materials));
  line("  {:<20}{}", "lights", light_words(facts.lights));
  line("decisions");
  for (const Decision& d : plan.decisions) line("  {:<20}{:<6}{}", d.subject, d.choice, d.reason);
  for (const std::string& warning : plan.warnings) line("warning: {}", warning);
  return text;
}

nlohmann::json plan_json(const JobSpec& spec, const SceneFacts& facts, const Plan& plan) {
  nlohmann::json decisions = nlohmann::json::array();
  for (const Decision& d : plan.decisions) {
    decisions.push_back({{"subject", d.subject}, {"choice", d.choice}, {"reason", d.reason}});
  }
  return {{"job", nlohmann::json::parse(canonical_json(spec))},
          {"scene", facts_json(facts)},
          {"plan",
           {{"algorithm", std::string(to_string(plan.algorithm))},
            {"decisions", std::move(decisions)},
            {"warnings", plan.warnings}}}};
}

std::string plan_line(const Plan& plan) {
  Words words;
  for (const Decision& d : plan.decisions) {
    words.push_back(d.subject == "algorithm" ? d.choice : fmt::format("{} {}", d.subject, d.choice));
  }
  return fmt::format("{}", fmt::join(words, "; "));
}

}  // namespace pf
