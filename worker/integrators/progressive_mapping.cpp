#include "worker/integrators/progressive_mapping.h"

#include <algorithm>
#include <cmath>
#include <span>

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

}  // namespace

ProgressiveMapping::ProgressiveMapping(const Scene& scene, const Camera& camera, const JobSpec& spec,
                                       const EyeSampling& sampling)
    : scene_(scene),
      sampling_(sampling),
      eye_(scene, camera, spec.image.width, spec.image.height, spec.integrator.seed),
      tracer_(scene, photon_options(spec)),
      fixed_radius_(spec.integrator.initial_radius),
      scene_radius_(0.5f * length(scene.bounds().size())),
      max_depth_(spec.integrator.max_depth) {
  film_.width = spec.image.width;
  film_.height = spec.image.height;
  film_.hit_points = sampling.hit_points;
  film_.extra = spec.integrator.error_estimate || spec.stop.error > 0.0 ? Extra::kBias : Extra::kNone;
  film_.estimator =
      spec.integrator.mode == ProgressiveMode::kShared ? Estimator::kShared : Estimator::kIndependent;
  film_.scale = scale_of_scene(scene, film_.estimator == Estimator::kShared ? tracer_.flux_unit() : 0.0);
  film_.alpha = spec.integrator.alpha;
  film_.round_growth = spec.integrator.round_growth;
}

ProgressiveMapping::Trees ProgressiveMapping::build_trees(PhotonBatch batch) const {
  Trees trees;
  parallel_invoke([&] { trees[kCaustic] = PhotonTree(std::move(batch.flows[kCaustic])); },
                  [&] { trees[kIndirect] = PhotonTree(std::move(batch.flows[kIndirect])); });
  return trees;
}

/// Chooses the first radii of a pixel and keeps its discs.
struct ProgressiveMapping::RadiusSink {
  const ProgressiveMapping& integrator;
  const Trees& trees;
  std::span<ProgressivePixel> points;  ///< of the pixel
  std::size_t first;                   ///< index of the first of them
  std::vector<GatherDisc>& discs;
  std::vector<std::size_t>& owners;    ///< of the discs
  TileFigures& figures;
  std::size_t gathers = 0;

  void ray() { ++figures.rays; }
  void escape(const EyeWalk&) {}
  void emitter(const SurfacePoint&, const Vec3f&, const EyeWalk&) {}
  void first_hit(const Vertex&, float) {}
  void direct(const Vertex&, float, const Vec2f&, float, const EyeWalk&) {}
  void gather(const Vertex& vertex, const Rgb&, const Vec2f& u, const EyeWalk& walk) {
    const float footprint = integrator.eye_.camera().footprint(walk.distance);
    const std::size_t point = std::min(gathers++, points.size() - 1);
    ProgressivePixel& pixel = points[point];
    for (const Flow flow : {kCaustic, kIndirect}) {
      const float radius2 = integrator.first_radius2(trees[flow], flow, vertex, footprint);
      float& least = pixel[flow].radius2;
      least = least > 0.0f ? std::min(least, radius2) : radius2;
    }
    const float widest = std::max(pixel[kCaustic].radius2, pixel[kIndirect].radius2);
    discs.push_back({vertex.point, query_at(vertex, widest), u});
    owners.push_back(first + point);
  }
};

float ProgressiveMapping::first_radius2(const PhotonTree& tree, Flow flow, const Vertex& vertex, float footprint) const {
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

std::vector<ProgressivePixel> ProgressiveMapping::initial_radii() const {
  const Trees trees = build_trees(tracer_.trace(0));
  const auto width = static_cast<std::size_t>(eye_.width());
  std::vector<ProgressivePixel> state(width * static_cast<std::size_t>(eye_.height()) * points());
  for (ProgressivePixel& point : state) point.covered_radius = kInfinity;
  Statistics figures;
  for_each_tile(eye_.width(), eye_.height(), figures, [&](const Tile& tile, TileFigures& sheet) {
    std::vector<GatherDisc> discs;
    std::vector<std::size_t> owners;
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) {
        const std::size_t i = (static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)) * points();
        RadiusSink sink{*this, trees, std::span(state).subspan(i, points()), i, discs, owners, sheet};
        for_each_eye_sample(0, [&](std::uint64_t sample) { EyePaths(scene_, eye_, max_depth_).follow(x, y, sample, sink); });
      }
    }
    find_covered_radii(scene_, discs, sheet.rays);
    for (std::size_t d = 0; d < discs.size(); ++d) {
      float& least = state[owners[d]].covered_radius;
      least = std::min(least, discs[d].covered_radius);
    }
  });
  if (sampling_.fixed == 0) fill_missing_radii(state);
  return state;
}

void ProgressiveMapping::fill_missing_radii(std::vector<ProgressivePixel>& state) const {
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

/// Adds up what a pixel's eye paths bring to it in one sub-pass.
struct ProgressiveMapping::RadianceSink {
  const ProgressiveMapping& integrator;
  const Trees& trees;
  std::span<const ProgressivePixel> state;  ///< of the pixel's hit points
  std::span<PixelSums> sums;                ///< likewise
  std::span<ExtraSums> extras;              ///< likewise; empty unless biases are estimated
  float ratio;                              ///< of squared radii to those in `state`
  float weight;                             ///< of one eye sample
  FeatureSums* features;                    ///< none where this eye sample does not count in them
  PixelSequence* lights;                    ///< sample points of direct light; none: the eye path's own
  TileFigures& figures;
  Tally& tally;
  /// Hit points so far. Where several share their statistics all bring flux, but only the first one's photons count in M, which
  /// decides how fast the radius shrinks: as if the path had not been split.
  std::size_t gathers = 0;

  void ray() { ++figures.rays; }
  void escape(const EyeWalk& walk) { tally.add_direct(environment_seen(integrator.scene_, walk) * weight); }
  void emitter(const SurfacePoint& point, const Vec3f& wo, const EyeWalk& walk) {
    tally.add_direct(emission_seen(integrator.scene_, point, wo, walk) * weight);
  }
  void first_hit(const Vertex& vertex, float distance) {
    if (features != nullptr) add_features(*features, integrator.film_.scale, vertex, distance);
  }
  void direct(const Vertex& vertex, float u_pick, const Vec2f& u, float p_follow, const EyeWalk& walk) {
    const float pick = lights != nullptr ? lights->next1() : u_pick;
    const Vec2f at = lights != nullptr ? lights->next2() : u;
    tally.add_direct(walk.beta * weight *
                     direct_light(integrator.scene_, vertex, walk.media, pick, at, Portion::kFollow, p_follow, figures.rays));
  }
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk&) {
    const std::size_t point = std::min(gathers, state.size() - 1);
    const bool steers = gathers++ == point;
    for (const Flow flow : {kCaustic, kIndirect}) gather_flow(flow, point, steers, vertex, beta * weight, u);
  }
  void gather_flow(Flow flow, std::size_t point, bool steers, const Vertex& vertex, const Rgb& beta, const Vec2f& u) {
    const DiscQuery query = query_at(vertex, state[point][flow].radius2 * ratio);
    std::uint32_t count = 0;
    Rgb flux = reflected_flux(trees[flow], query, vertex, count);
    if (count == 0) return;
    const bool with_bias = integrator.film_.extra == Extra::kBias;
    float moment = with_bias ? bias_moment(trees[flow], query, vertex, beta) : 0.0f;
    if (steers) sums[point].photons[flow] += count;
    flux *= beta;
    if (query.radius2 > state[point].covered_radius * state[point].covered_radius) {
      const float fraction = measure_coverage(integrator.scene_, vertex.point, query, u, figures.rays).fraction;
      flux /= fraction;
      moment /= fraction;
    }
    if (!is_finite(flux) || !std::isfinite(moment)) {
      ++figures.faults.not_finite;
      return;
    }
    if (integrator.film_.estimator == Estimator::kIndependent) {
      flux /= kPi * query.radius2;
      moment /= kPi * query.radius2;
    }
    bool exact = add_quantised(sums[point].flow[flow], flux, integrator.film_.scale.flow);
    if (with_bias) exact = add_quantised(extras[point].rgb[flow], moment, integrator.film_.scale.flow) && exact;
    if (!exact) ++figures.faults.overflow;
  }
  /// Sum of f * photon flux [W sr^-1] over the disc.
  [[nodiscard]] Rgb reflected_flux(const PhotonTree& tree, const DiscQuery& query, const Vertex& vertex,
                                   std::uint32_t& count) const {
    if (vertex.bsdf.gather_is_lambert()) {
      const FluxSum sum = tree.sum_flux(query);
      count = sum.count;
      const double step = integrator.tracer_.flux_unit() / kFluxSteps;
      return vertex.bsdf.lambert_f() * Rgb{static_cast<float>(static_cast<double>(sum.steps[0]) * step),
                                           static_cast<float>(static_cast<double>(sum.steps[1]) * step),
                                           static_cast<float>(static_cast<double>(sum.steps[2]) * step)};
    }
    const std::vector<std::uint32_t>& indices = found(tree, query);
    count = static_cast<std::uint32_t>(indices.size());
    Rgb sum{0.0f, 0.0f, 0.0f};
    for (const std::uint32_t i : indices) sum += reflected_photon(tree, i, vertex);
    return sum * static_cast<float>(integrator.tracer_.flux_unit());
  }
  [[nodiscard]] static const std::vector<std::uint32_t>& found(const PhotonTree& tree, const DiscQuery& query) {
    thread_local std::vector<std::uint32_t> indices;
    indices.clear();
    tree.collect(query, indices);
    return indices;
  }
  /// One photon's part, in units of flux_unit().
  [[nodiscard]] static Rgb reflected_photon(const PhotonTree& tree, std::uint32_t i, const Vertex& vertex) {
    const Rgb f = vertex.bsdf.gather_is_lambert()
                      ? vertex.bsdf.lambert_f()
                      : vertex.bsdf.eval(vertex.wo, tree.towards_light(i), Transport::kRadiance, Portion::kGather);
    return f * tree.flux(i);
  }
  /// What the disc's bias is estimated from. With a flux density p + c d^2 around the middle, photons at distance d sum up to
  /// pi R^2 (p + c R^2/2), and weighed by 6 d^2/R^2 - 3 to pi R^2 * c R^2/2, the bias: the Laplacian of [Hachisuka, Jarosz and
  /// Jensen 2010, 4.2], by a quadratic kernel over the same disc. Of the luminance; apart from the flux, whose bits must not
  /// depend on whether anybody asks for its error.
  [[nodiscard]] float bias_moment(const PhotonTree& tree, const DiscQuery& query, const Vertex& vertex, const Rgb& beta) const {
    float moment = 0.0f;
    for (const std::uint32_t i : found(tree, query)) {
      const Vec3f offset = tree.position(i) - query.position;
      moment += luminance(beta * reflected_photon(tree, i, vertex)) * (6.0f * dot(offset, offset) / query.radius2 - 3.0f);
    }
    return moment * static_cast<float>(integrator.tracer_.flux_unit());
  }
};

void ProgressiveMapping::run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const {
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
    const float weight = sampling_.fixed > 0 ? 1.0f / static_cast<float>(sampling_.fixed) : 1.0f;
    for_each_pixel(eye_.width(), eye_.height(), sums, [&](int x, int y, TileFigures& figures) {
      const std::size_t i = points() * (static_cast<std::size_t>(y) * static_cast<std::size_t>(eye_.width()) + static_cast<std::size_t>(x));
      Tally tally(sums.pixels[i], nullptr, film_.scale, figures.faults);
      PixelSequence lights = eye_.light_sequence(x, y, s);
      RadianceSink sink{*this, trees, std::span(state).subspan(i, points()), std::span(sums.pixels).subspan(i, points()),
                        sums.extras.empty() ? std::span<ExtraSums>() : std::span(sums.extras).subspan(i, points()),
                        static_cast<float>(ratio), weight, nullptr, sampling_.fixed > 0 ? &lights : nullptr, figures, tally};
      for_each_eye_sample(s, [&](std::uint64_t sample) {
        const bool counts = s < kFeatureSubPasses && (sampling_.fixed == 0 || sample == s % sampling_.fixed);
        sink.features = counts ? &sums.features[i] : nullptr;
        eye_paths.follow(x, y, sample, sink);
      });
      tally.commit();
    });
    ++sums.sub_passes;
  }
}

}  // namespace pf
