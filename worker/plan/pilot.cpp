#include "worker/plan/pilot.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "common/base/parallel.h"
#include "worker/integrators/eye_paths.h"
#include "worker/integrators/first_radius.h"
#include "worker/integrators/map_estimate.h"
#include "worker/integrators/path.h"
#include "worker/plan/forecast.h"

namespace pf {
namespace {

/// Of the eye samples of a pixel those that also ask the photons, which cost more than the rest of the
/// sample.
constexpr int kGatherSamples = 4;
/// Consecutive eye samples of a pixel whose means are compared: so many are stratified against each other.
constexpr int kGroup = 4;
/// Photons of a density estimate: 17 % noise at a place, far less in the mean over all places.
constexpr std::uint32_t kNearest = 36;
/// Emissions by which the lamps are told apart.
constexpr std::uint32_t kEmissions = 4096;
/// Added to squared radiance in relMSE (common/film/metrics.h).
constexpr double kOffset = 0.01;
constexpr std::uint64_t kSeed = 1;

double lum(const Rgb& c) { return static_cast<double>(luminance(c)); }

void look_at_lamps(const Scene& scene, Pilot& pilot) {
  const Lights& lights = scene.lights();
  pilot.flux = static_cast<double>(average(lights.total_flux()));
  const auto triangles = static_cast<std::uint32_t>(lights.triangle_count());
  const std::uint32_t sky = triangles + static_cast<std::uint32_t>(lights.punctual_count());
  double all = 0, delta = 0, environment = 0, lamps = 0, radiance = 0;
  for (std::uint32_t i = 0; i < kEmissions; ++i) {
    const float u = (static_cast<float>(i) + 0.5f) / kEmissions;
    const auto picked = lights.emit(u, {0.5f, 0.5f}, {0.5f, 0.5f});
    if (!picked) continue;
    const double flux = static_cast<double>(average(picked->emission.flux));
    all += flux;
    if (picked->triangle >= 0) {
      lamps += flux;
      radiance += flux * lum(lights.triangle(static_cast<std::uint32_t>(picked->triangle)).radiance);
    } else {
      (picked->emission.light >= sky ? environment : delta) += flux;
    }
  }
  if (all <= 0.0) return;
  pilot.delta_flux = delta / all;
  pilot.sky_flux = environment / all;
  pilot.lamp_radiance = lamps > 0.0 ? radiance / lamps : 0.0;
}

struct PilotMaps {
  std::array<MapEstimate, kFlows> of;
};

/// Traces batches of kPilotPhotons until they stored enough.
std::vector<PhotonBatch> trace_batches(const PhotonTracer& tracer, Pilot& pilot) {
  std::vector<PhotonBatch> batches;
  std::size_t stored = 0;
  std::uint64_t rays = 0, lost = 0;
  while (batches.size() < kMostPilotBatches && stored < kPilotStored) {
    const PhotonBatch& batch = batches.emplace_back(tracer.trace(batches.size()));
    for (const Photons& flow : batch.flows) stored += flow.size();
    rays += batch.rays;
    lost += batch.lost;
  }
  pilot.photon_paths = kPilotPhotons * static_cast<std::uint32_t>(batches.size());
  pilot.lost = static_cast<double>(lost) / pilot.photon_paths;
  pilot.photon_rays = static_cast<double>(rays) / pilot.photon_paths;
  return batches;
}

PilotMaps trace_photons(const Scene& scene, const JobSpec& spec, Pilot& pilot) {
  PhotonOptions options;
  options.seed = kSeed;
  options.paths = kPilotPhotons;
  options.max_depth = spec.integrator.max_depth;
  const PhotonTracer tracer(scene, options);
  const std::vector<PhotonBatch> batches = trace_batches(tracer, pilot);
  PilotMaps maps;
  for (const Flow flow : {kCaustic, kIndirect}) {
    std::vector<const Photons*> arrays;
    std::size_t stored = 0;
    for (const PhotonBatch& batch : batches) {
      arrays.push_back(&batch.flows[flow]);
      stored += batch.flows[flow].size();
    }
    pilot.stored[flow] = static_cast<double>(stored) / pilot.photon_paths;
    maps.of[flow] = MapEstimate(scene, arrays, tracer.flux_unit() / static_cast<double>(batches.size()),
                                {.nearest = kNearest, .filter = PhotonFilter::kDisc});
  }
  return maps;
}

/// What the eye samples of one pixel found: sums over its samples.
struct PixelFindings {
  double nothing = 0, diffuse = 0, glossy = 0, specular = 0;
  double direct = 0, direct_square = 0;
  double asked = 0, asked_square = 0;  ///< of direct light: the samples that ask the photons,
  double many = 0, many_square = 0;    ///< and the same with kPilotLightSamples of lamps
  std::uint64_t light_rays = 0;        ///< towards lamps
  double group = 0, group_square = 0;  ///< of direct light: sum of the last samples, squared means of whole groups
  double gathers = 0;
  std::array<double, kFlows> light{}, reflectance{};  ///< of the samples that ask the photons
  std::array<double, kFlows> density{}, weight{};     ///< photons per m^2 and path, weighed by light
  std::array<double, kFlows> footprint{};             ///< m, likewise
  double mirrored = 0;
  double path = 0, path_square = 0;
  std::array<double, kFlows> path_light{};
  TileFigures eye, traced;
  /// The first gather place of the first sample, where it is a Lambert surface seen directly.
  Vec3f normal{0, 0, 0};
  double irradiance = 0;
};

struct PilotSink {
  const Scene& scene;
  const Eye& eye;
  const PilotMaps& maps;
  PixelFindings& found;
  double paths = 0;     ///< of the photons in the maps
  bool asks = false;    ///< this sample asks the photons
  double radiance = 0;  ///< of this sample: what photon mapping samples from the eye
  double many = 0;      ///< the same with kPilotLightSamples of lamps at each point, where it asks

  void ray() { ++found.eye.rays; }
  void escape(const EyeWalk& walk) {
    add(environment_seen(scene, walk));
    found.nothing += walk.bounce == 0 ? 1.0 : 0.0;
  }
  void emitter(const SurfacePoint& point, const Vec3f& wo, const EyeWalk& walk) {
    add(emission_seen(scene, point, wo, walk));
  }
  void add(const Rgb& seen) {
    radiance += lum(seen);
    many += lum(seen);
  }
  void first_hit(const Vertex& vertex, float) {
    const Bsdf& bsdf = vertex.bsdf;
    const double gathered = static_cast<double>(average(bsdf.albedo(Portion::kGather)));
    const double followed = static_cast<double>(average(bsdf.albedo(Portion::kFollow)));
    if (bsdf.is_delta_only()) {
      found.specular += 1.0;
    } else if (!bsdf.gather_is_lambert() || gathered + followed <= 0.0) {
      (bsdf.is_black() ? found.diffuse : found.glossy) += 1.0;
    } else {
      const double share = gathered / (gathered + followed);
      found.diffuse += share;
      (bsdf.has_delta() ? found.specular : found.glossy) += 1.0 - share;
    }
  }
  void direct(const Vertex& vertex, float u_pick, const Vec2f& u, float p_follow, const EyeWalk& walk) {
    std::uint64_t rays = 0;
    radiance += lum(walk.beta * direct_light(scene, vertex, walk.media, u_pick, u, Portion::kFollow, p_follow, rays));
    found.light_rays += rays;
    found.eye.rays += rays;
    if (!asks) return;
    many += lum(walk.beta * direct_light(scene, vertex, walk.media, u_pick, u, Portion::kFollow, p_follow,
                                         kPilotLightSamples, rays));  // rays of the pilot, not of the job
  }
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk& walk) {
    found.gathers += 1.0;
    if (!asks) return;
    const double reflectance = lum(beta * vertex.bsdf.albedo(Portion::kGather));
    for (const Flow flow : {kCaustic, kIndirect}) {
      const MapEstimate& map = maps.of[flow];
      if (map.empty()) continue;
      const double light = lum(beta * map.radiance(scene, vertex, Portion::kGather, kInfinity, u, found.eye));
      found.light[flow] += light;
      found.reflectance[flow] += light * reflectance;
      if (flow == kCaustic && walk.bounce > 0) found.mirrored += light;
      thread_local NearestPhotons answer;
      const float reach = map.max_distance();
      map.photons().nearest({vertex.point.position, vertex.bsdf.ng(), reach * reach, kNearest, false}, answer);
      const double area = static_cast<double>(kPi * answer.radius2);
      if (light <= 0.0 || area <= 0.0) continue;
      found.density[flow] += light * static_cast<double>(answer.count) / (area * paths);
      found.footprint[flow] += light * static_cast<double>(eye.camera().footprint(walk.distance));
      found.weight[flow] += light;
    }
    if (found.irradiance > 0.0 || walk.bounce > 0 || !vertex.bsdf.gather_is_lambert()) return;
    found.normal = vertex.bsdf.ng();
    found.irradiance = lum(maps.of[kIndirect].irradiance(vertex.point.position, found.normal).irradiance);
  }
};

/// The pixels of a grid with about kPilotPixels cells of the image's shape, one in the middle of each.
struct Grid {
  int columns = 1, rows = 1, width = 1, height = 1;
  Grid(int w, int h) : width(w), height(h) {
    const double edge = std::sqrt(static_cast<double>(w) * h / kPilotPixels);
    columns = std::clamp(static_cast<int>(std::lround(w / std::max(edge, 1.0))), 1, w);
    rows = std::clamp(kPilotPixels / columns, 1, h);
    columns = std::clamp(kPilotPixels / rows, 1, w);
  }
  [[nodiscard]] std::size_t size() const { return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows); }
  [[nodiscard]] int x(std::size_t i) const {
    return middle(static_cast<int>(i % static_cast<std::size_t>(columns)), columns, width);
  }
  [[nodiscard]] int y(std::size_t i) const {
    return middle(static_cast<int>(i / static_cast<std::size_t>(columns)), rows, height);
  }

 private:
  static int middle(int cell, int cells, int length) {
    return static_cast<int>((2 * static_cast<std::int64_t>(cell) + 1) * length / (2 * cells));
  }
};

PixelFindings look(const Scene& scene, const Eye& eye, const PathIntegrator& paths, const PilotMaps& maps,
                   double photon_paths, int max_depth, int x, int y) {
  PixelFindings found;
  const EyePaths eye_paths(scene, eye, max_depth);
  const SumScale scale = paths.film_options().scale;
  for (int s = 0; s < kPilotSamples; ++s) {
    PilotSink sink{scene, eye, maps, found, photon_paths, s < kGatherSamples};
    eye_paths.follow(x, y, static_cast<std::uint64_t>(s), sink);
    found.direct += sink.radiance;
    found.direct_square += sink.radiance * sink.radiance;
    if (sink.asks) {
      found.asked += sink.radiance;
      found.asked_square += sink.radiance * sink.radiance;
      found.many += sink.many;
      found.many_square += sink.many * sink.many;
    }
    found.group += sink.radiance;
    if ((s + 1) % kGroup == 0) {
      found.group_square += found.group * found.group / (kGroup * kGroup);
      found.group = 0;
    }
    PixelSums sums;
    paths.trace(x, y, static_cast<std::uint64_t>(s), sums, nullptr, found.traced);
    const auto light = [&](const std::array<std::int64_t, 3>& rgb, double step) {
      return lum(Rgb(static_cast<float>(static_cast<double>(rgb[0]) * step),
                     static_cast<float>(static_cast<double>(rgb[1]) * step),
                     static_cast<float>(static_cast<double>(rgb[2]) * step)));
    };
    double radiance = light(sums.direct, scale.radiance);
    for (const Flow flow : {kCaustic, kIndirect}) {
      const double of_flow = light(sums.flow[flow], scale.flow);
      found.path_light[flow] += of_flow;
      radiance += of_flow;
    }
    found.path += radiance;
    found.path_square += radiance * radiance;
  }
  return found;
}

/// Photons that a first disc holds, in the mean, where `density` of them lie on a square metre: below 1 where most
/// discs are empty.
double photons_in_disc(const RadiusRule& rule, double density, double footprint, float scene_radius, double paths) {
  const RadiusBounds bounds = radius_bounds(rule, static_cast<float>(footprint), scene_radius);
  const auto held = [&](float radius) { return density * double{kPi} * double{radius} * double{radius}; };
  constexpr double kFewest = 0.01;  // of a disc without size
  return std::max(kFewest, std::clamp(wanted_photons(rule, paths), held(bounds.smallest), held(bounds.largest)));
}

/// Of `count` values with this mean.
double variance(double mean, double sum_of_squares, int count) {
  return std::max(0.0, (sum_of_squares / count - mean * mean) * count / (count - 1));
}

/// Sums over pixels of direct light's noise in the samples that ask the photons, and of that with many samples of
/// lamps.
struct LightNoise {
  double asked = 0, many = 0;
};

void add_pixel(const PixelFindings& found, float scene_radius, double paths, Pilot& pilot, LightNoise& noise) {
  pilot.nothing += found.nothing / kPilotSamples;
  pilot.diffuse += found.diffuse / kPilotSamples;
  pilot.glossy += found.glossy / kPilotSamples;
  pilot.specular += found.specular / kPilotSamples;
  pilot.gathers += found.gathers / kPilotSamples;
  pilot.eye_rays += static_cast<double>(found.eye.rays) / kPilotSamples;
  pilot.path_rays += static_cast<double>(found.traced.rays) / kPilotSamples;
  pilot.direct += found.direct / kPilotSamples;
  pilot.mirrored_caustic += found.mirrored / kGatherSamples;
  double reference = found.direct / kPilotSamples;
  std::array<double, kFlows> light;
  for (const Flow flow : {kCaustic, kIndirect}) {
    light[flow] = found.light[flow] / kGatherSamples;
    reference += light[flow];
    pilot.light[flow] += light[flow];
    pilot.path_light[flow] += found.path_light[flow] / kPilotSamples;
  }
  const double scale = 1.0 / (reference * reference + kOffset);
  pilot.path_noise += scale * variance(found.path / kPilotSamples, found.path_square, kPilotSamples);
  const double direct = found.direct / kPilotSamples;
  pilot.direct_noise += scale * variance(direct, found.direct_square, kPilotSamples);
  pilot.light_rays += static_cast<double>(found.light_rays) / kPilotSamples;
  noise.asked += scale * variance(found.asked / kGatherSamples, found.asked_square, kGatherSamples);
  noise.many += scale * variance(found.many / kGatherSamples, found.many_square, kGatherSamples);
  pilot.direct_group_noise += scale * variance(direct, found.group_square, kPilotSamples / kGroup);
  pilot.caustic_moment += scale * found.reflectance[kCaustic] / kGatherSamples;
  pilot.caustic_square += scale * light[kCaustic] * light[kCaustic];
  pilot.indirect_moment += scale * found.reflectance[kIndirect] / kGatherSamples;
  pilot.indirect_square += scale * light[kIndirect] * light[kIndirect];
  for (const Flow flow : {kCaustic, kIndirect}) {
    if (found.weight[flow] <= 0.0) continue;
    const double photons = photons_in_disc(kRadiusRules[flow], paths * found.density[flow] / found.weight[flow],
                                           found.footprint[flow] / found.weight[flow], scene_radius, paths);
    pilot.photon_noise[flow] += scale * light[flow] * light[flow] / photons;
  }
}

/// Mean of |a - b| / (a + b) over neighbours that face the same way.
double roughness_of(const std::vector<PixelFindings>& found, int columns) {
  double sum = 0;
  int pairs = 0;
  const auto compare = [&](const PixelFindings& a, const PixelFindings& b) {
    if (a.irradiance <= 0.0 || b.irradiance <= 0.0 || dot(a.normal, b.normal) < 0.9f) return;
    sum += std::abs(a.irradiance - b.irradiance) / (a.irradiance + b.irradiance);
    ++pairs;
  };
  const auto width = static_cast<std::size_t>(columns);
  for (std::size_t i = 0; i < found.size(); ++i) {
    if ((i + 1) % width != 0 && i + 1 < found.size()) compare(found[i], found[i + 1]);
    if (i + width < found.size()) compare(found[i], found[i + width]);
  }
  return pairs > 0 ? sum / pairs : 1.0;
}

}  // namespace

double Pilot::missed(Flow flow) const {
  if (light[flow] <= 0.0) return 0.0;
  constexpr double kOwnNoise = 0.2;  // of both means, seen on the example scenes
  const double missing = 1.0 - path_light[flow] / light[flow];
  return missing < kOwnNoise ? 0.0 : missing;
}

double Pilot::direct_power() const {
  constexpr double kLeast = 1.0, kMost = 1.5;
  if (!(direct_group_noise > 0.0)) return kMost;
  return std::clamp(std::log(direct_noise / direct_group_noise) / std::log(double{kGroup}), kLeast, kMost);
}

Pilot fly_pilot(const Scene& scene, const Camera& camera, const JobSpec& spec) {
  Pilot pilot;
  look_at_lamps(scene, pilot);
  const PilotMaps maps = trace_photons(scene, spec, pilot);
  const Grid grid(spec.image.width, spec.image.height);
  JobSpec own = spec;  // the job's seed changes noise, not what the scene needs
  own.integrator.seed = kSeed;
  const Eye eye(scene, camera, spec.image.width, spec.image.height, kSeed);
  const PathIntegrator paths(scene, camera, own);
  std::vector<PixelFindings> found(grid.size());
  parallel_for(found.size(), [&](std::size_t i) {
    found[i] = look(scene, eye, paths, maps, pilot.photon_paths, spec.integrator.max_depth, grid.x(i), grid.y(i));
  });
  pilot.pixels = static_cast<std::uint32_t>(found.size());
  pilot.samples = kPilotSamples;
  LightNoise noise;
  const float scene_radius = 0.5f * length(scene.bounds().size());
  for (const PixelFindings& pixel : found)
    add_pixel(pixel, scene_radius, static_cast<double>(photon_paths(spec)), pilot, noise);
  if (noise.asked > 0.0) pilot.light_noise_left = std::min(1.0, noise.many / noise.asked);
  const double share = 1.0 / static_cast<double>(found.size());
  for (double* mean : {&pilot.nothing,
                       &pilot.diffuse,
                       &pilot.glossy,
                       &pilot.specular,
                       &pilot.path_rays,
                       &pilot.eye_rays,
                       &pilot.light_rays,
                       &pilot.gathers,
                       &pilot.direct,
                       &pilot.light[kCaustic],
                       &pilot.light[kIndirect],
                       &pilot.path_light[kCaustic],
                       &pilot.path_light[kIndirect],
                       &pilot.mirrored_caustic,
                       &pilot.path_noise,
                       &pilot.direct_noise,
                       &pilot.direct_group_noise,
                       &pilot.caustic_moment,
                       &pilot.caustic_square,
                       &pilot.indirect_moment,
                       &pilot.indirect_square,
                       &pilot.photon_noise[kCaustic],
                       &pilot.photon_noise[kIndirect]}) {
    *mean *= share;
  }
  pilot.roughness = roughness_of(found, grid.columns);
  return pilot;
}

LearnedEmission fly_emission_pilot(const Scene& scene, const Camera& camera, const JobSpec& spec, const Pilot& pilot) {
  const IntegratorType type = spec.integrator.type;
  const bool of_use = type == IntegratorType::kAuto || type == IntegratorType::kPpm || type == IntegratorType::kSppm;
  if (!of_use || spec.integrator.guide_emission == Switch::kOff || !guide_could_pay(spec, pilot)) return {};
  return learn_emission(scene, camera, spec);
}

}  // namespace pf
