#include "worker/plan/forecast.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace pf {
namespace {

/// Work in rays of a path tracer with their shading, 0.63 us: fitted to 120 runs of sppm on the example scenes
/// (tests/bench/PLANNER.md), which it meets within 30 %.
constexpr double kEyeRay = 0.7, kGather = 2.6;
/// Of a further sample of direct light that shoots a ray.
constexpr double kLightRay = 1.1;
/// Of a photon's ray, and of storing and sorting one. Guided photons all come to where the eye looks, where surfaces
/// are fine and discs are full: their rays take twice as long with all that follows.
constexpr double kPhotonRay = 0.5, kStoredPhoton = 0.5, kGuidedRay = 1.1;
/// Of reading the irradiance cache at a place.
constexpr double kInterpolate = 1.0;
/// Gather rays of the irradiance cache for each diffuse pixel, in irradiance_cache.rays: 0.02 to 0.05 at so many
/// pixels, 0.006 to 0.03 at seven times as many, since records follow the room.
constexpr double kRecords = 0.045, kRecordsPixels = 7000.0, kRecordsPower = -0.3;
/// What interpolating records leaves of the map's own error (0.4 to 0.9 on the example scenes).
constexpr double kInterpolated = 0.5;

/// relMSE of sppm's density estimates over that of their noise in the first discs, by flow: blur adds to it, widened
/// discs take from it. 0.8 to 1.0 of indirect light on the example scenes; 0.4 to 0.8, and 1.3 in the glass, of
/// caustics.
constexpr std::array<double, kFlows> kErrorOverNoise{0.75, 0.9};
/// Power of the photon paths with which it falls: 2/3 by the rule for full discs, 1 where a disc may not grow to fill;
/// 0.7 to 0.8 were measured, 0.5 in the glass.
constexpr double kPathsPower = 0.75;
/// What a guide leaves of it is this power of its gain: noise falls with the gain, but discs stay where they are.
constexpr double kGainPower = 0.5;

double pixels_of(const JobSpec& spec) { return static_cast<double>(spec.image.width) * spec.image.height; }

/// Part of the light not found by chance that delta lights emit: the sky's is found.
double delta_part(const Pilot& pilot) {
  const double hidden = 1.0 - pilot.sky_flux;
  return hidden > 0.0 ? std::min(1.0, pilot.delta_flux / hidden) : 0.0;
}

/// Of a pass's eye samples, without what they ask the photons.
double eye_pass(const JobSpec& spec, const Pilot& pilot, int light_samples) {
  return pixels_of(spec) * (kEyeRay * pilot.eye_rays + kLightRay * pilot.light_rays * (light_samples - 1));
}

double gather_pass(const JobSpec& spec, const Pilot& pilot) { return pixels_of(spec) * kGather * pilot.gathers; }

/// A photon path with its photons.
double path_work(const Pilot& pilot) {
  return kPhotonRay * pilot.photon_rays + kStoredPhoton * (pilot.stored[kCaustic] + pilot.stored[kIndirect]);
}

/// Noise of direct light with so many samples of lamps at a point: between what the pilot saw with one and with
/// kPilotLightSamples by a power of their number.
double direct_noise(const Pilot& pilot, int light_samples) {
  return pilot.direct_noise * std::pow(pilot.light_noise_left, std::log(light_samples) / std::log(kPilotLightSamples));
}

/// Of choices in ascending order the first whose work is within kAsGood of the least: fewer photons or samples mean
/// more passes, and a sooner first look.
constexpr double kAsGood = 1.03;
template <typename Choices, typename Work>
auto first_as_good(const Choices& choices, const Work& work_of) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& choice : choices) least = std::min(least, work_of(choice));
  return *std::ranges::find_if(choices, [&](const auto& choice) { return work_of(choice) <= kAsGood * least; });
}

Forecast sppm_of(const JobSpec& spec, const Pilot& pilot, const SppmChoice& choice) {
  const double more = static_cast<double>(choice.photons) / static_cast<double>(photon_paths(spec));
  Forecast f;
  f.fast = direct_noise(pilot, choice.light_samples);
  f.power = pilot.direct_power();
  for (const Flow flow : {kCaustic, kIndirect})
    f.slow += kErrorOverNoise[flow] * pilot.photon_noise[flow] / std::pow(more, kPathsPower);
  double path = path_work(pilot);
  if (choice.guided) {
    f.slow *= std::pow(pilot.emission.gain, -kGainPower);
    path = kGuidedRay * std::max(pilot.emission.rays_per_path, pilot.photon_rays);
  }
  f.pass = static_cast<double>(choice.photons) * path + eye_pass(spec, pilot, choice.light_samples) +
           gather_pass(spec, pilot);
  f.setup = f.pass;  // the first radii look at one sub-pass more
  return f;
}

/// Photon paths of a pass of sppm: the job's, or so many a pixel and not fewer than that. Error at equal time over that
/// of the best of 1, 2, 4, 8 and 16 a pixel: at most 1.3 on the example scenes (tests/bench/PLANNER.md).
std::int64_t planned_photons(const JobSpec& spec) {
  constexpr std::int64_t kOfAPixel = 4, kFewest = 50'000;
  if (spec.integrator.photons > 0) return spec.integrator.photons;
  return std::clamp(kOfAPixel * spec.image.width * spec.image.height, kFewest, kMostPhotonPaths);
}

std::vector<int> choices_of_light_samples(const JobSpec& spec, int most) {
  if (spec.integrator.light_samples > 0) return {spec.integrator.light_samples};
  std::vector<int> choices;
  for (int samples = 1; samples <= most; samples *= 2) choices.push_back(samples);
  return choices;
}

/// Guided or not, with the samples of direct light that are soonest at an image that is kept.
SppmChoice best_sppm(const JobSpec& spec, const Pilot& pilot, bool guided) {
  constexpr int kMostBesidePhotons = 4;  // 8 were no better anywhere
  SppmChoice choice{planned_photons(spec), 1, guided};
  choice.light_samples = first_as_good(choices_of_light_samples(spec, kMostBesidePhotons), [&](int samples) {
    return sppm_of(spec, pilot, {choice.photons, samples, guided}).work_to(kFineTarget);
  });
  return choice;
}

/// Work of learn_emission().
double work_of_lessons(const JobSpec& spec, const Pilot& pilot) {
  const auto paths = static_cast<double>(std::min(photon_paths(spec), kMostLessonPaths));
  const double places = std::min<double>(pixels_of(spec), kEmissionPixels);
  return kEmissionLessons * (path_work(pilot) * paths + kGather * places * pilot.gathers) +
         places * kEyeRay * pilot.eye_rays;
}

/// Guided photons must not be foretold to take more than this part of the work: what a guide gains is not known so
/// well.
constexpr double kMostWork = 0.85;

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

SppmChoice plan_sppm(const JobSpec& spec, const Pilot& pilot) {
  const SppmChoice unguided = best_sppm(spec, pilot, false);
  if (spec.integrator.guide_emission == Switch::kOff) return unguided;
  const SppmChoice guided = best_sppm(spec, pilot, true);
  if (spec.integrator.guide_emission == Switch::kOn) return guided;
  // Below, the pilot's own noise could be all there is.
  constexpr double kLeastGain = 1.5;
  const auto work = [&](const SppmChoice& choice) { return sppm_of(spec, pilot, choice).work_to(kFineTarget); };
  const bool pays = pilot.emission.gain >= kLeastGain && work(guided) <= kMostWork * work(unguided);
  return pays ? guided : unguided;
}

bool guide_could_pay(const JobSpec& spec, const Pilot& pilot) {
  if (spec.integrator.guide_emission == Switch::kOn) return true;
  const Forecast unguided = sppm_of(spec, pilot, best_sppm(spec, pilot, false));
  Forecast best = unguided;  // no noise of photons at all
  best.slow = 0;
  const double lessons = work_of_lessons(spec, pilot);
  best.setup += lessons;
  constexpr double kMostLessons = 0.25;  // of the work to a first good look, which lessons put off
  return lessons <= kMostLessons * unguided.work_to(kPlanTarget) &&
         best.work_to(kFineTarget) <= kMostWork * unguided.work_to(kFineTarget);
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

Forecast forecast_sppm(const JobSpec& spec, const Pilot& pilot) { return sppm_of(spec, pilot, plan_sppm(spec, pilot)); }

int plan_light_samples(const JobSpec& spec, const Pilot& pilot, IntegratorType method) {
  if (method == IntegratorType::kPath) return 1;
  if (method == IntegratorType::kSppm || method == IntegratorType::kPpm) return plan_sppm(spec, pilot).light_samples;
  return first_as_good(choices_of_light_samples(spec, 8), [&](int samples) {
    return std::pow(direct_noise(pilot, samples), 1.0 / pilot.direct_power()) *
           (eye_pass(spec, pilot, samples) + pixels_of(spec) * kInterpolate * pilot.gathers);
  });
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
  f.pass = eye_pass(spec, pilot, light_samples) + pixels_of(spec) * kInterpolate * pilot.gathers;
  const double full_records =  // of so many rays as irradiance_cache.rays
      kRecords * std::pow(pixels_of(spec) / kRecordsPixels, kRecordsPower) * pixels_of(spec) * pilot.diffuse;
  const auto caustic_paths = pilot.stored[kCaustic] > 0.0 ? static_cast<double>(spec.photon_map.caustic_photons) : 0.0;
  f.setup = path_work(pilot) * (paths + caustic_paths) + full_records * spec.irradiance_cache.rays;
  return f;
}

}  // namespace pf
