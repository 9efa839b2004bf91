#include "worker/integrators/sppm.h"

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "worker/integrators/eye_paths.h"
#include "worker/photon/covered_area.h"

namespace pf {
namespace {

/// Photons of the first sub-pass that the first disc shall hold, and bounds of its radius in pixel footprints: wide where
/// light is smooth, narrow for caustics. Chosen on the peer box: 600 to
/// 800 photons lower its noise by 5 % and brighten corners.
struct RadiusRule {
  float photons;
  float min_footprints;
  float max_footprints;
};
constexpr std::array<RadiusRule, kFlows> kRadiusRules{RadiusRule{12.0f, 0.75f, 3.0f}, RadiusRule{400.0f, 1.0f, 16.0f}};

/// `photons` above is for sub-passes of this many paths; others get p^(2/3) times as many, so that the radius after a
/// given total of paths, which shrinks with the cube root of the sub-passes, does not depend on how they are cut.
constexpr double kRulePaths = 500000.0;

DiscQuery query_at(const Vertex& vertex, float radius2) {
  return {vertex.point.position, vertex.bsdf.ng(), radius2, vertex.transmissive && !vertex.bsdf.gather_is_lambert()};
}

PhotonOptions photon_options(const JobSpec& spec) {
  return {spec.integrator.seed, static_cast<std::uint32_t>(spec.integrator.photons), spec.integrator.max_depth};
}

}  // namespace

SppmIntegrator::SppmIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec)
    : scene_(scene),
      eye_(scene, camera, spec.image.width, spec.image.height, spec.integrator.seed),
      tracer_(scene, photon_options(spec)),
      fixed_radius_(spec.integrator.initial_radius),
      scene_radius_(0.5f * length(scene.bounds().size())),
      max_depth_(spec.integrator.max_depth) {
  film_.width = spec.image.width;
  film_.height = spec.image.height;
  film_.estimator =
      spec.integrator.mode == ProgressiveMode::kShared ? Estimator::kShared : Estimator::kIndependent;
  film_.scale = scale_of_scene(scene, film_.estimator == Estimator::kShared ? tracer_.flux_unit() : 0.0);
  film_.alpha = spec.integrator.alpha;
  film_.round_growth = spec.integrator.round_growth;
}

SppmIntegrator::Trees SppmIntegrator::build_trees(PhotonBatch batch) const {
  Trees trees;
  parallel_invoke([&] { trees[kCaustic] = PhotonTree(std::move(batch.flows[kCaustic])); },
                  [&] { trees[kIndirect] = PhotonTree(std::move(batch.flows[kIndirect])); });
  return trees;
}

/// Chooses the first radii of a pixel and keeps its discs.
struct SppmIntegrator::RadiusSink {
  const SppmIntegrator& integrator;
  const Trees& trees;
  ProgressivePixel& pixel;
  std::vector<GatherDisc>& discs;
  TileFigures& figures;

  void ray() { ++figures.rays; }
  void escape(const EyeWalk&) {}
  void emitter(const SurfacePoint&, const Vec3f&, const EyeWalk&) {}
  void first_hit(const Vertex&, float) {}
  void direct(const Vertex&, float, const Vec2f&, float, const EyeWalk&) {}
  void gather(const Vertex& vertex, const Rgb&, const Vec2f& u, const EyeWalk& walk) {
    const float footprint = integrator.eye_.camera().footprint(walk.distance);
    for (const Flow flow : {kCaustic, kIndirect}) {
      const float radius2 = integrator.first_radius2(trees[flow], flow, vertex, footprint);
      float& least = pixel[flow].radius2;
      least = least > 0.0f ? std::min(least, radius2) : radius2;
    }
    const float widest = std::max(pixel[kCaustic].radius2, pixel[kIndirect].radius2);
    discs.push_back({vertex.point, query_at(vertex, widest), u});
  }
};

float SppmIntegrator::first_radius2(const PhotonTree& tree, Flow flow, const Vertex& vertex, float footprint) const {
  if (fixed_radius_ > 0.0) return static_cast<float>(fixed_radius_ * fixed_radius_);
  const RadiusRule& rule = kRadiusRules[flow];
  // No disc is wider than a part of the scene, however far away the surface is seen from.
  constexpr float kMaxSceneShare = 0.05f;  // 0.08 brightens the corners of the peer box visibly
  const float largest = std::min(rule.max_footprints * footprint, kMaxSceneShare * scene_radius_);
  const float smallest = std::min(rule.min_footprints * footprint, largest);
  DiscQuery query = query_at(vertex, largest * largest);
  auto found = static_cast<float>(tree.count(query));
  const auto wanted = static_cast<float>(rule.photons * std::pow(tracer_.options().paths / kRulePaths, 2.0 / 3.0));
  // On a surface the number found goes with the area.
  for (int refinement = 0; refinement < 3 && found > wanted && query.radius2 > smallest * smallest; ++refinement) {
    query.radius2 = std::max(query.radius2 * wanted / found, smallest * smallest);
    found = static_cast<float>(tree.count(query));
  }
  return query.radius2;
}

std::vector<ProgressivePixel> SppmIntegrator::initial_radii() const {
  const Trees trees = build_trees(tracer_.trace(0));
  const auto width = static_cast<std::size_t>(eye_.width());
  std::vector<ProgressivePixel> state(width * static_cast<std::size_t>(eye_.height()));
  Statistics figures;
  for_each_tile(eye_.width(), eye_.height(), figures, [&](const Tile& tile, TileFigures& sheet) {
    std::vector<GatherDisc> discs;
    std::vector<std::size_t> pixels;  // of the discs
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x);
        state[i].covered_radius = kInfinity;
        RadiusSink sink{*this, trees, state[i], discs, sheet};
        EyePaths(scene_, eye_, max_depth_).follow(x, y, 0, sink);
        pixels.resize(discs.size(), i);
      }
    }
    find_covered_radii(scene_, discs, sheet.rays);
    for (std::size_t d = 0; d < discs.size(); ++d) {
      float& least = state[pixels[d]].covered_radius;
      least = std::min(least, discs[d].covered_radius);
    }
  });
  fill_missing_radii(state);
  return state;
}

void SppmIntegrator::fill_missing_radii(std::vector<ProgressivePixel>& state) const {
  // A pixel whose first samples met no surface may meet one later: it takes the radii of the nearest pixel in its row, or else
  // of the row above or below.
  const auto width = static_cast<std::size_t>(eye_.width());
  const auto known = [](const ProgressivePixel& p) { return p[kIndirect].radius2 > 0.0f; };
  const auto adopt = [&](ProgressivePixel& p, const ProgressivePixel& from) {
    if (known(p) || !known(from)) return;
    p = from;
    p.covered_radius = 0.0f;
  };
  for (std::size_t row = 0; row < state.size(); row += width) {
    for (std::size_t x = 1; x < width; ++x) adopt(state[row + x], state[row + x - 1]);
    for (std::size_t x = width - 1; x > 0; --x) adopt(state[row + x - 1], state[row + x]);
  }
  for (std::size_t i = width; i < state.size(); ++i) adopt(state[i], state[i - width]);
  for (std::size_t i = state.size(); i > width; --i) adopt(state[i - 1 - width], state[i - 1]);
  constexpr float kFallbackShare = 0.01f;  // of the scene: nothing at all was met in the whole image
  ProgressivePixel fallback;
  for (FlowState& flow : fallback.flow) flow.radius2 = kFallbackShare * kFallbackShare * scene_radius_ * scene_radius_;
  for (ProgressivePixel& p : state) adopt(p, fallback);
}

/// Adds up what one eye path brings to its pixel.
struct SppmIntegrator::RadianceSink {
  const SppmIntegrator& integrator;
  const Trees& trees;
  const ProgressivePixel& state;
  std::array<float, kFlows> radius2;
  PixelSums& sums;
  FeatureSums* features;  ///< none where the sub-pass is past kFeatureSubPasses
  TileFigures& figures;
  Tally& tally;
  /// Hit points of this sample so far. All of them bring flux; only the first one's photons count in M, which decides how
  /// fast the radius shrinks: as if the path had not been split.
  int gathers = 0;

  void ray() { ++figures.rays; }
  void escape(const EyeWalk& walk) { tally.add_direct(environment_seen(integrator.scene_, walk)); }
  void emitter(const SurfacePoint& point, const Vec3f& wo, const EyeWalk& walk) {
    tally.add_direct(emission_seen(integrator.scene_, point, wo, walk));
  }
  void first_hit(const Vertex& vertex, float distance) {
    if (features != nullptr) add_features(*features, integrator.film_.scale, vertex, distance);
  }
  void direct(const Vertex& vertex, float u_pick, const Vec2f& u, float p_follow, const EyeWalk& walk) {
    tally.add_direct(walk.beta *
                     direct_light(integrator.scene_, vertex, walk.media, u_pick, u, Portion::kFollow, p_follow, figures.rays));
  }
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk&) {
    ++gathers;
    for (const Flow flow : {kCaustic, kIndirect}) gather_flow(flow, vertex, beta, u);
  }
  void gather_flow(Flow flow, const Vertex& vertex, const Rgb& beta, const Vec2f& u) {
    const DiscQuery query = query_at(vertex, radius2[flow]);
    std::uint32_t count = 0;
    Rgb flux = reflected_flux(trees[flow], query, vertex, count);
    if (count == 0) return;
    if (gathers == 1) sums.photons[flow] += count;
    flux *= beta;
    if (query.radius2 > state.covered_radius * state.covered_radius) {
      flux /= measure_coverage(integrator.scene_, vertex.point, query, u, figures.rays).fraction;
    }
    if (!is_finite(flux)) {
      ++figures.faults.not_finite;
      return;
    }
    if (integrator.film_.estimator == Estimator::kIndependent) flux /= kPi * radius2[flow];
    if (!add_quantised(sums.flow[flow], flux, integrator.film_.scale.flow)) ++figures.faults.overflow;
  }
  /// Sum of f * photon flux [W sr^-1] over the disc.
  [[nodiscard]] Rgb reflected_flux(const PhotonTree& tree, const DiscQuery& query, const Vertex& vertex,
                                   std::uint32_t& count) const {
    const auto unit = static_cast<float>(integrator.tracer_.flux_unit());
    if (vertex.bsdf.gather_is_lambert()) {
      const FluxSum sum = tree.sum_flux(query);
      count = sum.count;
      const double step = integrator.tracer_.flux_unit() / kFluxSteps;
      return vertex.bsdf.lambert_f() * Rgb{static_cast<float>(static_cast<double>(sum.steps[0]) * step),
                                           static_cast<float>(static_cast<double>(sum.steps[1]) * step),
                                           static_cast<float>(static_cast<double>(sum.steps[2]) * step)};
    }
    thread_local std::vector<std::uint32_t> indices;
    indices.clear();
    tree.collect(query, indices);
    count = static_cast<std::uint32_t>(indices.size());
    Rgb sum{0.0f, 0.0f, 0.0f};
    for (const std::uint32_t i : indices) {
      sum += vertex.bsdf.eval(vertex.wo, tree.towards_light(i), Transport::kRadiance, Portion::kGather) * tree.flux(i);
    }
    return sum * unit;
  }
};

void SppmIntegrator::run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const {
  for (std::uint64_t s = unit.first_sub_pass; s < unit.first_sub_pass + unit.sub_passes; ++s) {
    PhotonBatch batch = tracer_.trace(s);
    sums.photon_paths += tracer_.options().paths;
    for (const PhotonArrays& photons : batch.flows) sums.photons_stored += photons.size();
    sums.rays += batch.rays;
    sums.faults += batch.faults;
    const Trees trees = build_trees(std::move(batch));
    const EyePaths eye_paths(scene_, eye_, max_depth_);
    const double ratio =
        film_.estimator == Estimator::kIndependent ? independent_radius2_ratio(s, film_.alpha) : 1.0;
    for_each_pixel(eye_.width(), eye_.height(), sums, [&](int x, int y, TileFigures& figures) {
      const std::size_t i =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(eye_.width()) + static_cast<std::size_t>(x);
      Tally tally(sums.pixels[i], nullptr, film_.scale, figures.faults);
      RadianceSink sink{*this, trees, state[i],
                        {static_cast<float>(state[i][kCaustic].radius2 * ratio),
                         static_cast<float>(state[i][kIndirect].radius2 * ratio)},
                        sums.pixels[i], s < kFeatureSubPasses ? &sums.features[i] : nullptr, figures, tally};
      eye_paths.follow(x, y, s, sink);
      tally.commit();
    });
    ++sums.sub_passes;
  }
}

}  // namespace pf
