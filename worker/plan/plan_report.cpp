#include <array>
#include <cmath>
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
  const bool photons = plan.algorithm == IntegratorType::kSppm || plan.algorithm == IntegratorType::kPpm;
  Words words;
  if (spec.stop.passes > 0) {
    words.push_back(
        photons ? fmt::format("{} passes of {} photon paths", spec.stop.passes, photon_paths(plan.resolve(spec)))
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

double target_of(const JobSpec& spec) {
  return spec.stop.error > 0.0 ? spec.stop.error * spec.stop.error : kPlanTarget;
}

nlohmann::json finite(double value) { return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr); }

/// Seconds until the error is at most the target: least, likely, most.
std::array<double, 3> seconds_to(const Forecast& f, double target, double per_work) {
  return {per_work * f.work_to(target * kForecastFactor), per_work * f.work_to(target),
          per_work * f.work_to(target / kForecastFactor)};
}

std::string duration(double seconds) {
  if (!std::isfinite(seconds)) return "never";
  if (seconds < 120.0) return seconds < 9.5 ? fmt::format("{:.1f} s", seconds) : fmt::format("{:.0f} s", seconds);
  return seconds < 7200.0 ? fmt::format("{:.0f} min", seconds / 60.0) : fmt::format("{:.0f} h", seconds / 3600.0);
}

std::string forecast_words(const JobSpec& spec, const Pilot& pilot, const Plan& plan, const PilotTiming& timing) {
  const Forecast* f = plan.forecast();
  if (f == nullptr)
    return fmt::format("none for {}: its error is blur that more passes do not remove", to_string(plan.algorithm));
  const double target = target_of(spec);
  const auto seconds = seconds_to(*f, target, timing.per_work(pilot));
  return fmt::format(
      "relMSE {:.2g} after {} ({} to {}), {} passes, on this machine alone", target, duration(seconds[1]),
      duration(seconds[0]), duration(seconds[2]),
      std::isfinite(f->passes_to(target)) ? fmt::format("{:.0f}", f->passes_to(target)) : "any number of");
}

/// The pilot's evidence: what it measured, in words.
std::vector<std::pair<std::string, std::string>> pilot_lines(const Pilot& p, const PilotTiming& timing) {
  const double light = p.direct + p.light[kCaustic] + p.light[kIndirect];
  const auto share = [&](double part) { return light > 0.0 ? 100.0 * part / light : 0.0; };
  return {
      {"traced", fmt::format("{} photon paths, {} pixels of {} eye samples in {:.2g} s", p.photon_paths, p.pixels,
                             p.samples, timing.seconds)},
      {"lamps", fmt::format("{:.3g} % of the flux from lamps without size, {:.3g} % from the sky; the "
                            "others' radiance is {:.3g}",
                            100.0 * p.delta_flux, 100.0 * p.sky_flux, p.lamp_radiance)},
      {"photons", fmt::format("{:.3g} % meet nothing; {:.2g} rays a path; {:.2g} caustic and {:.2g} other "
                              "photons stored of each",
                              100.0 * p.lost, p.photon_rays, p.stored[kCaustic], p.stored[kIndirect])},
      {"seen first", fmt::format("{:.3g} % diffuse, {:.3g} % glossy, {:.3g} % mirrors and glass, {:.3g} % nothing",
                                 100.0 * p.diffuse, 100.0 * p.glossy, 100.0 * p.specular, 100.0 * p.nothing)},
      {"direct light", fmt::format("{:.3g} %", share(p.direct))},
      {"caustics",
       fmt::format("{:.3g} %, of which paths from the eye found {:.3g} %; {:.3g} % seen in mirrors or through glass",
                   share(p.light[kCaustic]), 100.0 * (1.0 - p.missed(kCaustic)), share(p.mirrored_caustic))},
      {"indirect light",
       fmt::format("{:.3g} %, of which paths from the eye found {:.3g} %; differs by {:.2g} % between neighbours",
                   share(p.light[kIndirect]), 100.0 * (1.0 - p.missed(kIndirect)), 100.0 * p.roughness)},
      {"noise of a pass",
       fmt::format("relMSE {:.2g} by path tracing, {:.2g} of direct light alone, {:.2g} of photons", p.path_noise,
                   p.direct_noise, p.photon_noise[kCaustic] + p.photon_noise[kIndirect])},
  };
}

nlohmann::json flows(const std::array<double, kFlows>& of) {
  return {{"caustic", of[kCaustic]}, {"indirect", of[kIndirect]}};
}

nlohmann::json pilot_json(const Pilot& p) {
  return {
      {"photon_paths", p.photon_paths},
      {"pixels", p.pixels},
      {"samples_per_pixel", p.samples},
      {"flux_watts", p.flux},
      {"delta_flux_share", p.delta_flux},
      {"sky_flux_share", p.sky_flux},
      {"lamp_radiance", p.lamp_radiance},
      {"lost_share", p.lost},
      {"rays_per_photon_path", p.photon_rays},
      {"stored_per_photon_path", flows(p.stored)},
      {"seen_share", {{"nothing", p.nothing}, {"diffuse", p.diffuse}, {"glossy", p.glossy}, {"specular", p.specular}}},
      {"rays_per_path_sample", p.path_rays},
      {"rays_per_eye_sample", p.eye_rays},
      {"gathers_per_eye_sample", p.gathers},
      {"direct_radiance", p.direct},
      {"radiance_by_photons", flows(p.light)},
      {"radiance_by_paths", flows(p.path_light)},
      {"mirrored_caustic_radiance", p.mirrored_caustic},
      {"missed_by_paths_share", {{"caustic", p.missed(kCaustic)}, {"indirect", p.missed(kIndirect)}}},
      {"path_noise", p.path_noise},
      {"direct_noise", p.direct_noise},
      {"direct_power", p.direct_power()},
      {"light_samples", {{"taken", kPilotLightSamples}, {"noise_left", p.light_noise_left}}},
      {"light_rays_per_eye_sample", p.light_rays},
      {"photon_noise", flows(p.photon_noise)},
      {"guided_emission",
       {{"gain", p.emission.gain}, {"paths", p.emission.paths}, {"rays_per_path", p.emission.rays_per_path}}},
      {"indirect_roughness", p.roughness}};
}

nlohmann::json forecast_json(const JobSpec& spec, const Pilot& pilot, const Plan& plan, const PilotTiming& timing) {
  const double target = target_of(spec);
  nlohmann::json methods = nlohmann::json::object();
  for (const Candidate& c : plan.candidates) {
    const Forecast& f = c.forecast;
    const auto seconds = seconds_to(f, target, timing.per_work(pilot));
    methods[std::string(to_string(c.method))] = {{"noise_per_pass", f.fast},
                                                 {"photon_noise_first_pass", f.slow},
                                                 {"floor", f.floor},
                                                 {"passes", finite(f.passes_to(target))},
                                                 {"seconds", finite(seconds[1])},
                                                 {"seconds_least", finite(seconds[0])},
                                                 {"seconds_most", finite(seconds[2])}};
  }
  return {{"relative_mse", target}, {"pilot_seconds", timing.seconds}, {"methods", std::move(methods)}};
}

}  // namespace

double PilotTiming::per_work(const Pilot& pilot) const {
  const double eye =
      static_cast<double>(pilot.pixels) * pilot.samples * (pilot.path_rays + pilot.eye_rays + pilot.gathers);
  const double work = eye + pilot.photon_paths * pilot.photon_rays;
  return work > 0.0 ? seconds / work : 0.0;
}

std::string plan_text(const JobSpec& spec, const SceneFacts& facts, const Pilot& pilot, const Plan& plan,
                      const PilotTiming& timing) {
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
  line("pilot");
  for (const auto& [what, words] : pilot_lines(pilot, timing)) line("  {:<20}{}", what, words);
  line("decisions");
  for (const Decision& d : plan.decisions) line("  {:<20}{:<9}{}", d.subject, d.choice, d.reason);
  line("forecast");
  line("  {}", forecast_words(spec, pilot, plan, timing));
  for (const std::string& warning : plan.warnings) line("warning: {}", warning);
  return text;
}

nlohmann::json plan_json(const JobSpec& spec, const SceneFacts& facts, const Pilot& pilot, const Plan& plan,
                         const PilotTiming& timing) {
  nlohmann::json decisions = nlohmann::json::array();
  for (const Decision& d : plan.decisions) {
    decisions.push_back({{"subject", d.subject}, {"choice", d.choice}, {"reason", d.reason}});
  }
  return {{"job", nlohmann::json::parse(canonical_json(spec))},
          {"scene", facts_json(facts)},
          {"pilot", pilot_json(pilot)},
          {"forecast", forecast_json(spec, pilot, plan, timing)},
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
