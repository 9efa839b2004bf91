#include "worker/plan/plan.h"

#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace pf {
namespace {

std::string plural(std::int64_t n, std::string_view singular, std::string_view plural_form) {
  return fmt::format("{} {}", n, n == 1 ? singular : plural_form);
}

std::string caster_words(const CausticFacts& caustics, int count) {
  std::string words = plural(count, "surface that focuses light", "surfaces that focus light");
  if (!caustics.names.empty()) words += fmt::format(" ({})", fmt::join(caustics.names, ", "));
  return words;
}

Decision choose_algorithm(const SceneFacts& facts) {
  const auto path = [](std::string reason) { return Decision{"algorithm", "path", std::move(reason)}; };
  const auto sppm = [](std::string reason) { return Decision{"algorithm", "sppm", std::move(reason)}; };
  const CausticFacts& caustics = facts.caustics;
  if (!facts.lights.any()) return path("nothing emits light: the image is black whatever computes it");
  if (caustics.lights_in_glass > 0) {
    return sppm(fmt::format("{} inside glass: paths from the eye cannot aim at a light through a refraction",
                            plural(caustics.lights_in_glass, "light stands", "lights stand")));
  }
  if (caustics.reached_by_small > 0) {
    const std::string words = caster_words(caustics, caustics.reached_by_small);
    if (caustics.smallest_light == 0.0) {
      return sppm(words +
                  " lit by a point, spot or directional light: paths from the eye never find such caustics");
    }
    return sppm(
        fmt::format("{} lit by a light that fills {:.2g} % of their sphere: paths from the eye find such "
                    "caustics too rarely",
                    words, 100.0 * caustics.smallest_light));
  }
  if (caustics.reached_by_large > 0) {
    return path(
        fmt::format("{} lit only by large lights or the environment: paths from the eye find such caustics",
                    caster_words(caustics, caustics.reached_by_large)));
  }
  if (caustics.casters > 0)
    return path("no light shines on the surfaces that could focus it: there are no caustics");
  return path(
      "no surface focuses light: there are no caustics, and aiming at the lights is unbiased and fast");
}

/// A term that is on exactly when `count` is not zero.
void decide(Plan& plan, bool& term, std::string subject, bool on, std::string why_on, std::string why_off) {
  term = on;
  plan.decisions.push_back(
      {std::move(subject), on ? "on" : "off", on ? std::move(why_on) : std::move(why_off)});
}

void decide_terms(const JobSpec& spec, const SceneFacts& facts, Plan& plan) {
  const MaterialCounts& m = facts.materials;
  const int reached = facts.caustics.reached_by_small + facts.caustics.reached_by_large;
  const bool photons = plan.algorithm != IntegratorType::kPath;
  decide(plan, plan.caustic_statistics, "caustic statistics", photons && reached > 0,
         caster_words(facts.caustics, reached) + " reached by light",
         photons ? "no light reaches a surface that focuses it" : "the algorithm traces no photons");
  decide(plan, plan.environment, "environment", facts.lights.environment,
         facts.lights.environment_map ? "the job names a map" : "the job sets a constant radiance",
         "neither a map nor a radiance is set");
  decide(plan, plan.textures, "textures", facts.textures > 0,
         plural(facts.textures, "texture is used", "textures are used"), "no material in use has one");
  decide(plan, plan.normal_maps, "normal maps", facts.normal_maps > 0,
         plural(facts.normal_maps, "material has one", "materials have one"), "no material in use has one");
  decide(plan, plan.alpha, "alpha", m.alpha_mask + m.alpha_blend > 0,
         fmt::format("{} cut out, {} blended", plural(m.alpha_mask, "material", "materials"), m.alpha_blend),
         "every material in use is opaque");
  decide(plan, plan.rough_lobes, "rough lobes", facts.rough_lobes > 0,
         plural(facts.rough_lobes, "material scatters into one", "materials scatter into one"),
         "every material in use is Lambert, a perfect mirror or smooth glass");
  decide(plan, plan.media, "absorption", facts.media > 0,
         plural(facts.media, "material absorbs inside", "materials absorb inside"),
         "no material in use bounds an absorbing medium");
  decide(plan, plan.depth_of_field, "depth of field", spec.scene.lens_radius > 0.0,
         fmt::format("scene.lens_radius is {} m, in focus at {} m", spec.scene.lens_radius,
                     spec.scene.focus_distance),
         "scene.lens_radius is 0: a pinhole");
}

}  // namespace

Plan make_plan(const JobSpec& spec, const SceneFacts& facts) {
  Plan plan;
  const IntegratorType asked = spec.integrator.type;
  if (asked == IntegratorType::kAuto) {
    Decision decision = choose_algorithm(facts);
    plan.algorithm = decision.choice == "sppm" ? IntegratorType::kSppm : IntegratorType::kPath;
    plan.decisions.push_back(std::move(decision));
  } else {
    plan.algorithm = asked;
    plan.decisions.push_back(
        {"algorithm", std::string(to_string(asked)), "the job asks for it (integrator.type)"});
  }
  decide_terms(spec, facts, plan);
  if (!facts.lights.any()) {
    plan.warnings.emplace_back(
        "the scene has no light; expected an emissive material, a KHR_lights_punctual light or "
        "scene.environment");
  }
  if (facts.triangles == 0) plan.warnings.emplace_back("the scene has no triangles");
  return plan;
}

}  // namespace pf
