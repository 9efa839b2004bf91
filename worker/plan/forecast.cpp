#include "worker/plan/forecast.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace pf {
namespace {

/// Work of a photon's ray with storing and sorting, and of a gather, in eye rays: 0.7, 1.1 and 1.0 us were
/// measured on the example scenes.
constexpr double kPhotonRay = 0.65, kGather = 0.9;
/// Work of a further sample of direct light that shoots a ray, in eye rays: 0.5 to 1.2 us were measured.
constexpr double kLightRay = 0.8;
/// Gather rays of the irradiance cache for each diffuse pixel, in irradiance_cache.rays: 0.02 to 0.05 at so many
/// pixels, 0.006 to 0.03 at seven times as many, since records follow the room.
constexpr double kRecords = 0.045, kRecordsPixels = 7000.0, kRecordsPower = -0.3;
/// What interpolating records leaves of the map's own error (0.4 to 0.9 on the example scenes).
constexpr double kInterpolated = 0.5;

/// relMSE of sppm's density estimates over that of their noise alone, by flow: blur adds to it, widened discs take from
/// it (2.6 to 6 where indirect light rules, 1.2 for the caustic of a ball, in images below relMSE 0.001).
constexpr std::array<double, kFlows> kErrorOverNoise{1.2, 4.0};

double pixels_of(const JobSpec& spec) { return static_cast<double>(spec.image.width) * spec.image.height; }

/// Part of the light not found by chance that delta lights emit: the sky's is found.
double delta_part(const Pilot& pilot) {
  const double hidden = 1.0 - pilot.sky_flux;
  return hidden > 0.0 ? std::min(1.0, pilot.delta_flux / hidden) : 0.0;
}

double eye_pass(const JobSpec& spec, const Pilot& pilot, int light_samples) {
  return pixels_of(spec) *
         (pilot.eye_rays + kLightRay * pilot.light_rays * (light_samples - 1) + kGather * pilot.gathers);
}

/// Noise of direct light with so many samples of lamps at a point: between what the pilot saw with one and with
/// kPilotLightSamples by a power of their number.
double direct_noise(const Pilot& pilot, int light_samples) {
  return pilot.direct_noise * std::pow(pilot.light_noise_left, std::log(light_samples) / std::log(kPilotLightSamples));
}

/// Of choices in ascending order the first whose work is within this factor of the least: fewer photons or samples mean
/// more passes, and a sooner first look.
template <typename Choices, typename Work>
auto first_as_good(const Choices& choices, double as_good, const Work& work_of) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& choice : choices) least = std::min(least, work_of(choice));
  return *std::ranges::find_if(choices, [&](const auto& choice) { return work_of(choice) <= as_good * least; });
}

/// What a pass of sppm does.
struct SppmChoice {
  std::int64_t paths = 0;
  int light_samples = 1;
  bool guided = false;
};

/// First discs hold photons in proportion to paths^(2/3), so that errors fall likewise.
Forecast sppm_of(const JobSpec& spec, const Pilot& pilot, const SppmChoice& choice) {
  const double more = static_cast<double>(choice.paths) / static_cast<double>(photon_paths(spec));
  Forecast f;
  f.fast = direct_noise(pilot, choice.light_samples);
  f.power = pilot.direct_power();
  for (const Flow flow : {kCaustic, kIndirect})
    f.slow += kErrorOverNoise[flow] * pilot.photon_noise[flow] / std::pow(more, 2.0 / 3.0);
  double rays = pilot.photon_rays;
  if (choice.guided) {
    f.slow /= pilot.emission.gain;
    rays = pilot.emission.rays_per_path;
  }
  f.pass = kPhotonRay * static_cast<double>(choice.paths) * rays + eye_pass(spec, pilot, choice.light_samples);
  f.setup = f.pass;  // the first radii look at one sub-pass more
  return f;
}

/// Unguided: what a guide saves is not known so well that fewer photons could be risked.
double unguided_work(const JobSpec& spec, const Pilot& pilot, std::int64_t paths, int light_samples) {
  return sppm_of(spec, pilot, {paths, light_samples, false}).judged_work();
}

/// Photon paths of a pass that sppm chooses among: the job's, or 1, 2, 4 ... 32 a pixel.
std::vector<std::int64_t> choices_of_photons(const JobSpec& spec) {
  if (spec.integrator.photons > 0) return {spec.integrator.photons};
  std::vector<std::int64_t> choices;
  for (int a_pixel = 1; a_pixel <= 32; a_pixel *= 2) {
    choices.push_back(
        std::clamp(std::int64_t{a_pixel} * spec.image.width * spec.image.height, kFewestPhotonPaths, kMostPhotonPaths));
  }
  return choices;
}

/// As sppm is planned, guided or not.
SppmChoice planned_sppm(const JobSpec& spec, const Pilot& pilot, bool guided) {
  return {plan_photons(spec, pilot), plan_light_samples(spec, pilot, IntegratorType::kSppm), guided};
}

/// Work of learn_emission().
double work_of_lessons(const JobSpec& spec, const Pilot& pilot) {
  const auto paths = static_cast<double>(std::min(photon_paths(spec), kMostLessonPaths));
  const double places = std::min<double>(pixels_of(spec), kEmissionPixels);
  return kEmissionLessons * (kPhotonRay * paths * pilot.photon_rays + kGather * places * pilot.gathers) +
         places * pilot.eye_rays;
}

/// Guided photons must not be foretold to take more than this part of the work: they all come to where the eye looks
/// and cost up to 1.45 times as much to sort and gather, which the forecast leaves out.
constexpr double kMostWork = 0.65;

}  // namespace

double Forecast::error(double passes) const {
  return fast / std::pow(passes, power) + slow / std::pow(passes, 2.0 / 3.0) + floor;
}

double Forecast::passes_to(double target) const {
  if (floor >= target) return std::numeric_limits<double>::infinity();
  double low = 1.0, high = 1.0;
  while (error(high) > target) high *= 2.0;  // ends: the error falls to its floor
  while (high - low > 1e-6 * high) {
    const double middle = 0.5 * (low + high);
    (error(middle) > target ? low : high) = middle;
  }
  const double whole = std::floor(high);
  return whole >= 1.0 && error(whole) <= target ? whole : whole + 1.0;
}

double Forecast::work_to(double target) const { return setup + passes_to(target) * pass; }

double Forecast::judged_work() const { return std::sqrt(work_to(kPlanTarget) * work_to(kFineTarget)); }

bool guides_emission(const JobSpec& spec, const Pilot& pilot) {
  if (spec.integrator.guide_emission != Switch::kAuto) return spec.integrator.guide_emission == Switch::kOn;
  // Below, the pilot's own noise could be all there is.
  constexpr double kLeastGain = 1.5;
  if (pilot.emission.gain < kLeastGain) return false;
  return sppm_of(spec, pilot, planned_sppm(spec, pilot, true)).judged_work() <=
         kMostWork * sppm_of(spec, pilot, planned_sppm(spec, pilot, false)).judged_work();
}

bool guide_could_pay(const JobSpec& spec, const Pilot& pilot) {
  if (spec.integrator.guide_emission == Switch::kOn) return true;
  const Forecast unguided = sppm_of(spec, pilot, planned_sppm(spec, pilot, false));
  Forecast best = unguided;  // no noise of photons at all
  best.slow = 0;
  const double lessons = work_of_lessons(spec, pilot);
  best.setup += lessons;
  constexpr double kMostLessons = 0.25;  // of the work to a first good look, which lessons put off
  return lessons <= kMostLessons * unguided.work_to(kPlanTarget) &&
         best.judged_work() <= kMostWork * unguided.judged_work();
}

Forecast forecast_path(const JobSpec& spec, const Pilot& pilot) {
  Forecast f;
  const double delta = delta_part(pilot);
  const double caustic = pilot.missed(kCaustic), indirect = pilot.missed(kIndirect);
  // A lamp of radiance Le that is met with probability p brings p Le, with the moment p Le^2: what is missed
  // is bright and rare.
  f.fast = pilot.path_noise +
           (1.0 - delta) * pilot.lamp_radiance * (caustic * pilot.caustic_moment + indirect * pilot.indirect_moment);
  f.floor = delta * delta * (caustic * caustic * pilot.caustic_square + indirect * indirect * pilot.indirect_square);
  f.pass = pixels_of(spec) * pilot.path_rays;
  return f;
}

Forecast forecast_sppm(const JobSpec& spec, const Pilot& pilot) {
  return sppm_of(spec, pilot, planned_sppm(spec, pilot, guides_emission(spec, pilot)));
}

int plan_light_samples(const JobSpec& spec, const Pilot& pilot, IntegratorType method) {
  if (method == IntegratorType::kPath) return 1;
  if (spec.integrator.light_samples > 0) return spec.integrator.light_samples;
  constexpr std::array kChoices{1, 2, 4, 8};
  constexpr double kAsGood = 1.03;
  if (method == IntegratorType::kSppm || method == IntegratorType::kPpm) {
    return first_as_good(kChoices, kAsGood, [&](int samples) {
      double least = std::numeric_limits<double>::infinity();
      for (const std::int64_t paths : choices_of_photons(spec))
        least = std::min(least, unguided_work(spec, pilot, paths, samples));
      return least;
    });
  }
  return first_as_good(kChoices, kAsGood, [&](int samples) {
    return std::pow(direct_noise(pilot, samples), 1.0 / pilot.direct_power()) * eye_pass(spec, pilot, samples);
  });
}

std::int64_t plan_photons(const JobSpec& spec, const Pilot& pilot) {
  const int light_samples = plan_light_samples(spec, pilot, IntegratorType::kSppm);
  constexpr double kAsGood = 1.1;
  return first_as_good(choices_of_photons(spec), kAsGood,
                       [&](std::int64_t paths) { return unguided_work(spec, pilot, paths, light_samples); });
}

Forecast forecast_irradiance_cache(const JobSpec& spec, const Pilot& pilot) {
  Forecast f;
  JobSpec cached = spec;
  cached.integrator.type = IntegratorType::kIrradianceCache;
  const auto paths = static_cast<double>(photon_paths(cached));
  const int light_samples = plan_light_samples(spec, pilot, IntegratorType::kIrradianceCache);
  f.fast = direct_noise(pilot, light_samples);
  // The pilot's estimate is of other discs; both hold photons in proportion to paths^(2/3).
  const double more = std::pow(static_cast<double>(photon_paths(spec)) / paths, 2.0 / 3.0);
  f.floor = kInterpolated * more * (pilot.photon_noise[kCaustic] + pilot.photon_noise[kIndirect]);
  f.pass = eye_pass(spec, pilot, light_samples);
  const double full_records =  // of so many rays as irradiance_cache.rays
      kRecords * std::pow(pixels_of(spec) / kRecordsPixels, kRecordsPower) * pixels_of(spec) * pilot.diffuse;
  const auto caustic_paths = pilot.stored[kCaustic] > 0.0 ? static_cast<double>(spec.photon_map.caustic_photons) : 0.0;
  f.setup = kPhotonRay * pilot.photon_rays * (paths + caustic_paths) + full_records * spec.irradiance_cache.rays;
  return f;
}

}  // namespace pf
