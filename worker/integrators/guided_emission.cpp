#include "worker/integrators/guided_emission.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/base/parallel.h"
#include "worker/integrators/eye_paths.h"
#include "worker/integrators/first_radius.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/photon_tree.h"

namespace pf {
namespace {

/// Where the first guide gained less than this although many paths (of equal worth) taught it, no other will gain much:
/// closed rooms, of which the eye sees most.
constexpr double kHopelessGain = 1.25, kManyExamples = 256.0;
constexpr std::uint64_t kSeed = 1;  // whatever the job's
/// Sub-passes that no job counts to: the pilot's numbers are its own.
constexpr std::uint64_t kPilotSubPass = std::uint64_t{1} << 63;
/// Radiances below this share of the image's mean do not count as dark: an error there is small beside the image.
constexpr double kDarkShare = 0.1;

/// A place where a pixel gathers photons.
struct Place {
  DiscQuery query;
  float footprint = 0;     ///< [m]
  double reflectance = 0;  ///< luminance of the radiance that a unit of irradiance brings to the pixel
};

/// What the eye sees at a pixel of the grid.
struct Look {
  double direct = 0;  ///< luminance
  std::vector<Place> places;
};

struct LookSink {
  const Scene& scene;
  const Eye& eye;
  Look& look;
  std::uint64_t& rays;

  void ray() { ++rays; }
  void add(const Rgb& radiance) {
    if (is_finite(radiance)) look.direct += double{luminance(radiance)};
  }
  void escape(const EyeWalk& walk) { add(environment_seen(scene, walk)); }
  void emitter(const SurfacePoint& point, const Vec3f& wo, const EyeWalk& walk) {
    add(emission_seen(scene, point, wo, walk));
  }
  void first_hit(const Vertex&, float) {}
  void direct(const Vertex& vertex, float u_pick, const Vec2f& u, float p_follow, const EyeWalk& walk) {
    add(walk.beta * direct_light(scene, vertex, walk.media, u_pick, u, Portion::kFollow, p_follow, rays));
  }
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f&, const EyeWalk& walk) {
    const Rgb reflectance = beta * vertex.bsdf.albedo(Portion::kGather) / kPi;
    look.places.push_back(
        {{vertex.point.position, vertex.bsdf.ng(), 0.0f, vertex.transmissive && !vertex.bsdf.gather_is_lambert()},
         eye.camera().footprint(walk.distance),
         double{luminance(reflectance)}});
  }
};

std::vector<Look> look_around(const Scene& scene, const Eye& eye, int max_depth) {
  const double edge =
      std::max(1.0, std::sqrt(double{static_cast<double>(eye.width()) * eye.height()} / kEmissionPixels));
  const int columns = std::max(1, static_cast<int>(eye.width() / edge));
  const int rows = std::max(1, static_cast<int>(eye.height() / edge));
  std::vector<Look> looks(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  const EyePaths paths(scene, eye, max_depth);
  parallel_for(looks.size(), [&](std::size_t i) {
    const auto column = static_cast<int>(i % static_cast<std::size_t>(columns));
    const auto row = static_cast<int>(i / static_cast<std::size_t>(columns));
    std::uint64_t rays = 0;
    LookSink sink{scene, eye, looks[i], rays};
    paths.follow(static_cast<int>((column + 0.5) * eye.width() / columns),
                 static_cast<int>((row + 0.5) * eye.height() / rows), kPilotSubPass, sink);
  });
  return looks;
}

/// A photon's part in what a disc shows.
struct Part {
  std::uint32_t path;
  double radiance;
};

/// Parts of all photons that a pixel gathers.
std::vector<Part> parts_of(const Look& look, const FirstRadius& rule, double flux_unit,
                           std::array<GatherCursor, kFlows>& photons) {
  std::vector<Part> parts;
  std::vector<std::uint32_t> indices;
  for (const Place& place : look.places) {
    for (const Flow flow : {kCaustic, kIndirect}) {
      const PhotonTree& tree = photons[flow].tree();
      DiscQuery query = place.query;
      query.radius2 = rule.squared(photons[flow], flow, query, place.footprint);
      indices.clear();
      photons[flow].collect(query, indices);
      const double scale = place.reflectance * flux_unit / (double{kPi} * double{query.radius2});
      for (const std::uint32_t i : indices) parts.push_back({tree.number(i), scale * double{luminance(tree.flux(i))}});
    }
  }
  return parts;
}

/// What the paths of a lesson were worth.
std::vector<double> worths(const std::vector<Look>& looks, const FirstRadius& rule, const PhotonTracer& tracer,
                           PhotonBatch batch) {
  std::array<PhotonTree, kFlows> trees;
  for (const Flow flow : {kCaustic, kIndirect}) trees[flow] = PhotonTree(std::move(batch.flows[flow]));
  std::vector<std::vector<Part>> parts(looks.size());
  std::vector<double> radiance(looks.size());
  constexpr std::size_t kGrain = 64;
  parallel_ranges(looks.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    std::array<GatherCursor, kFlows> photons{GatherCursor(trees[kCaustic]), GatherCursor(trees[kIndirect])};
    for (std::size_t i = begin; i < end; ++i) {
      parts[i] = parts_of(looks[i], rule, tracer.flux_unit(), photons);
      radiance[i] = looks[i].direct;
      for (const Part& part : parts[i]) radiance[i] += part.radiance;
    }
  });
  double mean = 0.0;
  for (const double r : radiance) mean += r / static_cast<double>(looks.size());
  const double dark = kDarkShare * mean;
  std::vector<double> worth(tracer.options().paths);
  for (std::size_t i = 0; i < looks.size(); ++i) {
    const double weight = 1.0 / (radiance[i] * radiance[i] + dark * dark);
    if (!std::isfinite(weight)) continue;
    for (const Part& part : parts[i]) worth[part.path] += weight * part.radiance * part.radiance;
  }
  return worth;
}

}  // namespace

LearnedEmission learn_emission(const Scene& scene, const Camera& camera, const JobSpec& spec) {
  LearnedEmission learned;
  const Eye eye(scene, camera, spec.image.width, spec.image.height, kSeed);
  const std::vector<Look> looks = look_around(scene, eye, spec.integrator.max_depth);
  PhotonOptions options = photon_options(spec);
  options.seed = kSeed;
  options.paths = static_cast<std::uint32_t>(std::min(photon_paths(spec), kMostLessonPaths));
  options.guide = &learned.guide;
  options.number_photons = true;
  const PhotonTracer tracer(scene, options);
  if (!(tracer.flux_unit() > 0.0)) return learned;
  const FirstRadius rule{spec.integrator.initial_radius, 0.5f * length(scene.bounds().size()),
                         static_cast<double>(options.paths)};
  std::vector<EmissionGuide::Example> examples;
  for (int lesson = 0; lesson < kEmissionLessons; ++lesson) {
    const std::uint64_t sub_pass = kPilotSubPass + static_cast<std::uint64_t>(lesson);
    PhotonBatch batch = tracer.trace(sub_pass);
    learned.paths += options.paths;
    learned.rays_per_path = static_cast<double>(batch.rays) / options.paths;
    const std::vector<double> worth = worths(looks, rule, tracer, std::move(batch));
    double uniform = 0.0, guided = 0.0, squares = 0.0;
    for (std::uint32_t path = 0; path < options.paths; ++path) {
      const EmissionGuide::Drawn start = tracer.emission(sub_pass, path);
      const double weight = double{start.weight};
      examples.push_back({start.u, weight, worth[path] / (weight * weight)});
      uniform += worth[path] / weight;
      guided += worth[path];
      squares += worth[path] * worth[path];
    }
    if (guided > 0.0) learned.gain = uniform / guided;
    const double telling = squares > 0.0 ? guided * guided / squares : 0.0;
    if (lesson == 1 && learned.gain < kHopelessGain && telling > kManyExamples) break;
    learned.guide = EmissionGuide(examples);
  }
  return learned;
}

}  // namespace pf
