#include "worker/plan/plan.h"

#include <algorithm>
#include <cmath>
#include <limits>
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

/// Methods whose work is foretold within this factor of the least are taken for equal: path tracing goes
/// first among them, whose error falls fastest from there on and has no blur, then sppm, whose error has no
/// floor.
constexpr double kTie = 1.15;
/// Above this relMSE light that paths never find is missed in the image, however small its part in the mean
/// is.
constexpr double kNeverShown = 1e-4;
/// An irradiance cache is worth its records only on surfaces like these...
constexpr double kMostlyDiffuse = 0.9;
/// ... whose indirect light differs less than this between neighbours of the pilot's grid.
constexpr double kSmooth = 0.25;
/// Below this part of photons that meet nothing a projection map saves less than it costs
/// (ProjectionMap::sparse()). Tried for sppm, too, and dropped: in the pool its error falls by 7 % and its
/// time grows by 17 %.
constexpr double kSparse = 0.2;

std::string_view name_of(IntegratorType type) { return to_string(type); }

/// Work up to the errors that methods are compared at; infinite for what stays wrong in a way that shows.
double work_of(const Candidate& c) {
  if (c.method == IntegratorType::kPath && c.forecast.floor > kNeverShown)
    return std::numeric_limits<double>::infinity();
  return c.forecast.judged_work();
}

std::vector<Candidate> weigh(const JobSpec& spec, const Pilot& pilot) {
  std::vector<Candidate> candidates{{IntegratorType::kPath, forecast_path(spec, pilot)},
                                    {IntegratorType::kSppm, forecast_sppm(spec, pilot)}};
  if (pilot.diffuse >= kMostlyDiffuse && pilot.roughness <= kSmooth)
    candidates.push_back({IntegratorType::kIrradianceCache, forecast_irradiance_cache(spec, pilot)});
  double least = std::numeric_limits<double>::infinity();
  for (const Candidate& c : candidates) least = std::min(least, work_of(c));
  const auto chosen = std::find_if(candidates.begin(), candidates.end(),
                                   [&](const Candidate& c) { return work_of(c) <= kTie * least; });
  std::rotate(candidates.begin(), chosen, chosen + 1);
  std::stable_sort(candidates.begin() + 1, candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return work_of(a) < work_of(b); });
  return candidates;
}

/// Why light that reaches the eye is or is not within a path tracer's reach.
std::string path_words(const Pilot& pilot, const CausticFacts& caustics) {
  const double light = pilot.direct + pilot.light[kCaustic] + pilot.light[kIndirect];
  if (light <= 0.0) return "the eye sees no light";
  const double missed =
      pilot.missed(kCaustic) * pilot.light[kCaustic] + pilot.missed(kIndirect) * pilot.light[kIndirect];
  std::string words = fmt::format(
      "{:.3g} % of the light comes straight from lamps or sky, {:.3g} % by mirrors or glass, {:.3g} % from "
      "surface to surface",
      100.0 * pilot.direct / light, 100.0 * pilot.light[kCaustic] / light, 100.0 * pilot.light[kIndirect] / light);
  if (missed > 0.0) {
    words += fmt::format("; paths from the eye miss {:.3g} % of all, ", 100.0 * missed / light);
    words += pilot.delta_flux > 0.0 ? "as lamps without size cannot be met by chance"
                                    : fmt::format("as a lamp that fills {:.2g} % of a sphere is hardly ever met",
                                                  100.0 * caustics.smallest_light);
  }
  return words;
}

Decision choose_algorithm(const SceneFacts& facts, const Pilot& pilot, const std::vector<Candidate>& candidates) {
  if (pilot.flux <= 0.0) return {"algorithm", "path", "nothing emits light: the image is black whatever computes it"};
  const Candidate& best = candidates.front();
  std::string reason = path_words(pilot, facts.caustics);
  for (std::size_t i = 1; i < candidates.size(); ++i) {
    const auto ratio = [&](double target) {
      return candidates[i].forecast.work_to(target) / best.forecast.work_to(target);
    };
    reason += fmt::format("; {} would ", name_of(candidates[i].method));
    reason += std::isfinite(work_of(candidates[i]))
                  ? fmt::format("take {:.2g} times as long to relMSE {} and {:.2g} times to {}", ratio(kPlanTarget),
                                kPlanTarget, ratio(kFineTarget), kFineTarget)
                  : fmt::format("end at relMSE {:.2g}", candidates[i].forecast.floor);
  }
  return {"algorithm", std::string(name_of(best.method)), std::move(reason)};
}

/// A term of the photons with its key.
struct Switchable {
  const char* name;
  const char* key;
  Switch asked;
};

void decide(Plan& plan, bool& term, std::string subject, bool on, std::string why_on, std::string why_off) {
  term = on;
  plan.decisions.push_back({std::move(subject), on ? "on" : "off", on ? std::move(why_on) : std::move(why_off)});
}

/// A term that the job may switch itself.
void decide(Plan& plan, bool& term, const Switchable& subject, bool traces, bool on, std::string why_on,
            std::string why_off) {
  if (!traces) return decide(plan, term, subject.name, false, "", "the algorithm has no use for it");
  if (subject.asked == Switch::kAuto)
    return decide(plan, term, subject.name, on, std::move(why_on), std::move(why_off));
  const std::string asked = fmt::format("the job asks for it ({})", subject.key);
  decide(plan, term, subject.name, subject.asked == Switch::kOn, asked, asked);
}

bool keeps_maps(IntegratorType type) {
  return type == IntegratorType::kPhotonMap || type == IntegratorType::kFinalGather ||
         type == IntegratorType::kIrradianceCache;
}

void decide_photons(const JobSpec& spec, const Pilot& pilot, Plan& plan) {
  if (plan.algorithm == IntegratorType::kPath) return;
  if (plan.algorithm == IntegratorType::kSppm) plan.photons = plan_sppm(spec, pilot).photons;
  const std::int64_t paths = photon_paths(plan.resolve(spec));
  const double pixels = static_cast<double>(spec.image.width) * spec.image.height;
  std::string reason = fmt::format("{:.2g} a pixel", static_cast<double>(paths) / pixels);
  if (plan.photons > 0) {
    reason += fmt::format("; the eye's own noise is {:.2g}, that of photons {:.2g} in the first pass",
                          pilot.direct_noise, forecast_sppm(spec, pilot).slow);
  }
  if (keeps_maps(plan.algorithm)) reason = "as many as a map wants that is made once";
  if (spec.integrator.photons > 0) reason = "the job asks for them (integrator.photons)";
  plan.decisions.push_back({"photons", std::to_string(paths), std::move(reason)});
}

void decide_light_samples(const JobSpec& spec, const Pilot& pilot, Plan& plan) {
  plan.light_samples = plan_light_samples(spec, pilot, plan.algorithm);
  std::string reason = fmt::format("{} at a point instead of 1 leave {:.2g} of the eye's own noise", kPilotLightSamples,
                                   pilot.light_noise_left);
  if (plan.algorithm == IntegratorType::kPath)
    reason = "path takes one at each bounce";
  else if (spec.integrator.light_samples > 0)
    reason = "the job asks for them (integrator.light_samples)";
  plan.decisions.push_back({"light samples", std::to_string(plan.light_samples), std::move(reason)});
}

void decide_photon_terms(const JobSpec& spec, const SceneFacts& facts, const Pilot& pilot, Plan& plan) {
  const bool traces = plan.algorithm != IntegratorType::kPath;
  const CausticFacts& caustics = facts.caustics;
  const int reached = caustics.reached_by_small + caustics.reached_by_large;
  const double found = pilot.stored[kCaustic] * pilot.photon_paths;
  const bool any = found > 0.0 || reached > 0 || caustics.lights_in_glass > 0;
  decide(plan, plan.caustic_map, {"caustic map", "photon_map.caustic_map", spec.photon_map.caustic_map}, traces, any,
         fmt::format("{}; {:.0f} of {} photons came to a surface by mirrors or glass", caster_words(caustics, reached),
                     found, pilot.photon_paths),
         fmt::format("no lamp shines on a surface that focuses light, and none of {} photons came by one",
                     pilot.photon_paths));
  const bool progressive = plan.algorithm == IntegratorType::kSppm || plan.algorithm == IntegratorType::kPpm;
  const std::string gain = fmt::format("{} paths taught a guide whose photons bring {:.2g} times less noise",
                                       pilot.emission.paths, pilot.emission.gain);
  decide(plan, plan.guided_emission, {"guided emission", "integrator.guide_emission", spec.integrator.guide_emission},
         progressive, plan_sppm(spec, pilot).guided, gain, gain);
  const std::string lost = fmt::format("{:.3g} % of the photons meet nothing", 100.0 * pilot.lost);
  const bool aimed = plan.caustic_map;
  decide(plan, plan.projection_map, {"projection map", "photon_map.projection_map", spec.photon_map.projection_map},
         keeps_maps(plan.algorithm), pilot.lost > kSparse || aimed,
         aimed ? "photons of the caustic map go only where mirrors and glass are; " + lost : lost, lost);
}

void decide_terms(const JobSpec& spec, const SceneFacts& facts, Plan& plan) {
  const MaterialCounts& m = facts.materials;
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
         fmt::format("scene.lens_radius is {} m, in focus at {} m", spec.scene.lens_radius, spec.scene.focus_distance),
         "scene.lens_radius is 0: a pinhole");
}

}  // namespace

const Forecast* Plan::forecast() const {
  for (const Candidate& c : candidates) {
    if (c.method == algorithm) return &c.forecast;
  }
  return nullptr;
}

JobSpec Plan::resolve(const JobSpec& spec) const {
  JobSpec resolved = spec;
  resolved.integrator.type = algorithm;
  if (photons > 0) resolved.integrator.photons = photons;
  resolved.integrator.light_samples = light_samples;
  resolved.integrator.guide_emission = guided_emission ? Switch::kOn : Switch::kOff;
  resolved.photon_map.caustic_map = caustic_map ? Switch::kOn : Switch::kOff;
  // Where the view is sparse the maps look for themselves what each of them needs.
  if (!projection_map) resolved.photon_map.projection_map = Switch::kOff;
  return resolved;
}

Plan make_plan(const JobSpec& spec, const SceneFacts& facts, const Pilot& pilot) {
  Plan plan;
  const IntegratorType asked = spec.integrator.type;
  plan.candidates = weigh(spec, pilot);
  if (asked == IntegratorType::kAuto) {
    Decision decision = choose_algorithm(facts, pilot, plan.candidates);
    plan.algorithm = decision.choice == "path" ? IntegratorType::kPath : plan.candidates.front().method;
    plan.decisions.push_back(std::move(decision));
  } else {
    plan.algorithm = asked;
    plan.decisions.push_back({"algorithm", std::string(to_string(asked)), "the job asks for it (integrator.type)"});
  }
  decide_photons(spec, pilot, plan);
  decide_light_samples(spec, pilot, plan);
  decide_photon_terms(spec, facts, pilot, plan);
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
