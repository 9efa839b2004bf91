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

double eye_pass(const JobSpec& spec, const Pilot& pilot) {
  return pixels_of(spec) * (pilot.eye_rays + kGather * pilot.gathers);
}

/// sppm with so many photon paths a pass. First discs hold photons in proportion to paths^(2/3), so that
/// errors fall likewise.
Forecast sppm_of(const JobSpec& spec, const Pilot& pilot, std::int64_t paths, bool guided) {
  const double more = static_cast<double>(paths) / static_cast<double>(photon_paths(spec));
  Forecast f;
  f.fast = pilot.direct_noise;
  f.power = pilot.direct_power();
  for (const Flow flow : {kCaustic, kIndirect})
    f.slow += kErrorOverNoise[flow] * pilot.photon_noise[flow] / std::pow(more, 2.0 / 3.0);
  double rays = pilot.photon_rays;
  if (guided) {
    f.slow /= pilot.emission.gain;
    rays = pilot.emission.rays_per_path;
  }
  f.pass = kPhotonRay * static_cast<double>(paths) * rays + eye_pass(spec, pilot);
  f.setup = f.pass;  // the first radii look at one sub-pass more
  return f;
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
  const std::int64_t paths = plan_photons(spec, pilot);
  return sppm_of(spec, pilot, paths, true).judged_work() <=
         kMostWork * sppm_of(spec, pilot, paths, false).judged_work();
}

bool guide_could_pay(const JobSpec& spec, const Pilot& pilot) {
  if (spec.integrator.guide_emission == Switch::kOn) return true;
  const Forecast unguided = sppm_of(spec, pilot, plan_photons(spec, pilot), false);
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
  return sppm_of(spec, pilot, plan_photons(spec, pilot), guides_emission(spec, pilot));
}

std::int64_t plan_photons(const JobSpec& spec, const Pilot& pilot) {
  if (spec.integrator.photons > 0) return spec.integrator.photons;
  struct Choice {
    std::int64_t paths;
    double work;
  };
  std::vector<Choice> choices;
  double least = std::numeric_limits<double>::infinity();
  for (int a_pixel = 1; a_pixel <= 32; a_pixel *= 2) {
    const auto paths =
        std::clamp(std::int64_t{a_pixel} * spec.image.width * spec.image.height, kFewestPhotonPaths, kMostPhotonPaths);
    choices.push_back({paths, sppm_of(spec, pilot, paths, false).judged_work()});
    least = std::min(least, choices.back().work);
  }
  constexpr double kAsGood = 1.1;  // fewer photons: more passes, and a sooner first look
  const auto fewest =
      std::find_if(choices.begin(), choices.end(), [&](const Choice& c) { return c.work <= kAsGood * least; });
  return fewest->paths;
}

Forecast forecast_irradiance_cache(const JobSpec& spec, const Pilot& pilot) {
  Forecast f;
  JobSpec cached = spec;
  cached.integrator.type = IntegratorType::kIrradianceCache;
  const auto paths = static_cast<double>(photon_paths(cached));
  f.fast = pilot.direct_noise;
  // The pilot's estimate is of other discs; both hold photons in proportion to paths^(2/3).
  const double more = std::pow(static_cast<double>(photon_paths(spec)) / paths, 2.0 / 3.0);
  f.floor = kInterpolated * more * (pilot.photon_noise[kCaustic] + pilot.photon_noise[kIndirect]);
  f.pass = eye_pass(spec, pilot);
  const double records =
      kRecords * std::pow(pixels_of(spec) / kRecordsPixels, kRecordsPower) * pixels_of(spec) * pilot.diffuse;
  const auto caustic_paths = pilot.stored[kCaustic] > 0.0 ? static_cast<double>(spec.photon_map.caustic_photons) : 0.0;
  f.setup = kPhotonRay * pilot.photon_rays * (paths + caustic_paths) + records * spec.irradiance_cache.rays;
  return f;
}

}  // namespace pf
