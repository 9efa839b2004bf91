#pragma once

#include <array>
#include <cstdint>

#include "common/film/statistics.h"
#include "common/spec/job_spec.h"
#include "worker/integrators/guided_emission.h"
#include "worker/scene/scene.h"

namespace pf {

/// What a few photons from the lamps and a few paths from the eye find out about a job. Random numbers are
/// fixed, whatever the job's seed, and sums are taken in a fixed order: for one build and instruction set a
/// job has one pilot, on any machine and number of threads, so that all workers of a farm plan alike. Nothing
/// here is a time.
///
/// "Noise" is the relMSE (mean of (x - r)^2 / (r^2 + 0.01), luminance) of an image of one sample per pixel;
/// of n samples it is the n-th part.
struct Pilot {
  // Lamps, by what a path from the eye can find.
  double flux = 0;        ///< emitted [W], mean over channels
  double delta_flux = 0;  ///< part of it from point, spot and directional lights: never met by chance
  double sky_flux = 0;    ///< part of it from the environment
  double lamp_radiance =
      0;  ///< luminance of all other lamps, by flux [W sr^-1 m^-2]: the flux of small lamps is bright

  // Photons.
  std::uint32_t photon_paths = 0;
  double lost = 0;                      ///< part of the paths whose first ray meets nothing
  double photon_rays = 0;               ///< of a path
  std::array<double, kFlows> stored{};  ///< photons of a path, by flow

  // The eye.
  std::uint32_t pixels = 0, samples = 0;                      ///< of a pixel
  double nothing = 0, diffuse = 0, glossy = 0, specular = 0;  ///< what is seen first: parts that add up to 1
  double path_rays = 0;                                       ///< of a sample of path tracing
  double eye_rays = 0;                                        ///< of an eye sample of photon mapping
  double gathers = 0;                                         ///< places of an eye sample where photons are gathered

  // Radiance that reaches the eye, image means of luminance.
  double direct = 0;  ///< seen lamps and sky, and light straight from them, also in mirrors and through glass
  std::array<double, kFlows> light{};       ///< of the photons' flows
  std::array<double, kFlows> path_light{};  ///< the same as path tracing found it
  double mirrored_caustic = 0;  ///< part of light[kCaustic] that is seen in mirrors or through glass: L S+ D S+ E

  // Errors.
  double path_noise = 0;          ///< of path tracing, as far as its samples saw it
  double direct_noise = 0;        ///< of what photon mapping samples from the eye
  double direct_group_noise = 0;  ///< of the mean of four samples that are stratified against each other
  double light_noise_left = 1;    ///< part of direct_noise that stays with kPilotLightSamples at a point instead of one
  double light_rays = 0;          ///< of an eye sample, towards lamps
  double caustic_moment = 0;      ///< noise that hitting lamps of radiance 1 by chance adds for all caustics
  double caustic_square = 0;      ///< relMSE of an image without any caustic
  double indirect_moment = 0, indirect_square = 0;  ///< the same for indirect light
  std::array<double, kFlows> photon_noise{};  ///< relMSE of the first sub-pass's density estimates, without their blur
  LearnedEmission emission;                   ///< fly_emission_pilot(); otherwise nothing learned
  double roughness = 0;  ///< relative difference of indirect irradiance between neighbours on one surface: 0 smooth

  /// Part of a flow's light that paths from the eye did not find, 0 to 1; differences within the pilot's own
  /// noise are 0.
  [[nodiscard]] double missed(Flow flow) const;
  /// Power of the number of samples with which direct_noise falls: 1 where they are as good as independent, up to 1.5
  /// where stratifying them over passes helps.
  [[nodiscard]] double direct_power() const;
};

/// Photon paths of a batch; batches are traced until so many photons are stored, where few reach a surface.
inline constexpr std::uint32_t kPilotPhotons = 16384;
inline constexpr std::size_t kPilotStored = 4096, kMostPilotBatches = 8;
/// Pixels that are looked at, on a grid over the image, and eye samples of each.
inline constexpr int kPilotPixels = 384, kPilotSamples = 16;
/// Samples of direct light that some eye samples take besides at each of their points, stratified.
inline constexpr int kPilotLightSamples = 8;

/// Traces the pilot of a job: a tenth of a second on one thread, a few tenths in closed rooms.
[[nodiscard]] Pilot fly_pilot(const Scene& scene, const Camera& camera, const JobSpec& spec);
/// What guides the photons of the job's method, if it is one that can be guided, the job does not say no and what
/// `pilot` found leaves a guide something to save.
[[nodiscard]] LearnedEmission fly_emission_pilot(const Scene& scene, const Camera& camera, const JobSpec& spec,
                                                 const Pilot& pilot);

}  // namespace pf
