#include "worker/integrators/progressive_mapping.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "common/base/parallel.h"
#include "worker/integrators/eye_paths.h"
#include "worker/photon/covered_area.h"

namespace pf {
namespace {

DiscQuery query_at(const Vertex& vertex, float radius2) {
  return {vertex.point.position, vertex.bsdf.ng(), radius2, vertex.transmissive && !vertex.bsdf.gather_is_lambert()};
}

/// 0 stands for none yet.
void keep_least(float& least, float radius2) { least = least > 0.0f ? std::min(least, radius2) : radius2; }

PhotonOptions guided(PhotonOptions options, const EmissionGuide& guide) {
  options.guide = &guide;
  return options;
}

}  // namespace

ProgressiveMapping::ProgressiveMapping(const Scene& scene, const Camera& camera, const JobSpec& spec,
                                       const EyeSampling& sampling, EmissionGuide guide)
    : scene_(scene),
      sampling_(sampling),
      eye_(scene, camera, spec.image.width, spec.image.height, spec.integrator.seed),
      guide_(std::move(guide)),
      tracer_(scene, guided(photon_options(spec), guide_)),
      first_radius_{spec.integrator.initial_radius, 0.5f * length(scene.bounds().size()),
                    static_cast<double>(tracer_.options().paths)},
      max_depth_(spec.integrator.max_depth),
      light_samples_(std::max(1, spec.integrator.light_samples)) {
  film_.width = spec.image.width;
  film_.height = spec.image.height;
  film_.hit_points = sampling.hit_points;
  film_.extra = spec.integrator.error_estimate || spec.stop.error > 0.0 ? Extra::kBias : Extra::kNone;
  film_.estimator = spec.integrator.mode == ProgressiveMode::kShared ? Estimator::kShared : Estimator::kIndependent;
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

/// What a first disc is for, and the squared radii [m^2] to choose from.
struct ProgressiveMapping::FirstDisc {
  std::size_t point;                   ///< whose hit point it is
  std::array<float, kFlows> radius2;   ///< by the rules
  std::array<float, kFlows> widened2;  ///< where the surface reaches so far
};

/// Chooses the first radii of a pixel and keeps its discs.
struct ProgressiveMapping::RadiusSink {
  const ProgressiveMapping& integrator;
  Cursors& photons;
  std::size_t first;  ///< index of the pixel's first hit point
  std::vector<GatherDisc>& discs;
  std::vector<FirstDisc>& first_discs;  ///< likewise
  TileFigures& figures;
  std::size_t gathers = 0;

  void ray() { ++figures.rays; }
  void escape(const EyeWalk&) {}
  void emitter(const SurfacePoint&, const Vec3f&, const EyeWalk&) {}
  void first_hit(const Vertex&, float) {}
  void direct(const Vertex&, float, const Vec2f&, float, const EyeWalk&) {}
  void gather(const Vertex& vertex, const Rgb&, const Vec2f& u, const EyeWalk& walk) {
    const float footprint = integrator.eye_.camera().footprint(walk.distance);
    const std::size_t point = std::min(gathers++, integrator.points() - 1);
    const FirstRadius& rule = integrator.first_radius_;
    const DiscQuery query = query_at(vertex, 0.0f);
    FirstDisc disc{.point = first + point, .radius2 = {}, .widened2 = {}};
    for (const Flow flow : {kCaustic, kIndirect}) {
      disc.radius2[flow] = rule.squared(photons[flow], flow, query, footprint);
      disc.widened2[flow] = rule.widened(photons[flow], query, disc.radius2[flow]);
    }
    discs.push_back({vertex.point, query_at(vertex, std::max(disc.widened2[kCaustic], disc.widened2[kIndirect])), u});
    first_discs.push_back(disc);
  }
};

std::vector<ProgressivePixel> ProgressiveMapping::initial_radii() const {
  const Trees trees = build_trees(tracer_.trace(0));
  const auto width = static_cast<std::size_t>(eye_.width());
  std::vector<ProgressivePixel> state(width * static_cast<std::size_t>(eye_.height()) * points());
  for (ProgressivePixel& point : state) point.covered_radius = kInfinity;
  Statistics figures;
  for_each_tile(eye_.width(), eye_.height(), figures, [&](const Tile& tile, TileFigures& sheet) {
    std::vector<GatherDisc> discs;
    std::vector<FirstDisc> first_discs;
    Cursors photons{GatherCursor(trees[kCaustic]), GatherCursor(trees[kIndirect])};
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) {
        const std::size_t i = (static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)) * points();
        RadiusSink sink{*this, photons, i, discs, first_discs, sheet};
        const std::uint64_t samples = std::max<std::uint64_t>(sampling_.fixed, 1);
        for (std::uint64_t k = 0; k < samples; ++k) EyePaths(scene_, eye_, max_depth_).follow(x, y, k, sink);
      }
    }
    find_covered_radii(scene_, discs, sheet.rays);
    for (std::size_t d = 0; d < discs.size(); ++d) {
      const FirstDisc& disc = first_discs[d];
      ProgressivePixel& pixel = state[disc.point];
      const float covered = discs[d].covered_radius;
      for (const Flow flow : {kCaustic, kIndirect}) {
        const float widened2 = disc.widened2[flow];
        keep_least(pixel[flow].radius2, covered * covered >= widened2 ? widened2 : disc.radius2[flow]);
      }
      pixel.covered_radius = std::min(pixel.covered_radius, covered);
    }
  });
  if (sampling_.fixed == 0) fill_missing_radii(state);
  return state;
}

void ProgressiveMapping::fill_missing_radii(std::vector<ProgressivePixel>& state) const {
  // A pixel whose first samples met no surface may meet one later: it takes the radii of the nearest pixel in its row,
  // or else of the row above or below.
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
  for (FlowState& flow : fallback.flow)
    flow.radius2 = kFallbackShare * kFallbackShare * first_radius_.scene_radius * first_radius_.scene_radius;
  for (ProgressivePixel& p : state) adopt(p, fallback);
}

/// Adds up what a pixel's eye paths bring to it in one sub-pass.
struct ProgressiveMapping::RadianceSink {
  const ProgressiveMapping& integrator;
  Cursors& photons;
  std::span<const ProgressivePixel> state;  ///< of the pixel's hit points
  std::span<PixelSums> sums;                ///< likewise
  std::span<ExtraSums> extras;              ///< likewise; empty unless biases are estimated
  float ratio;                              ///< of squared radii to those in `state`
  float direct_weight;                      ///< of one eye sample in direct light
  float weight;                             ///< of one eye sample in what photons bring; 0: it does not gather
  FeatureSums* features;                    ///< none where this eye sample does not count in them
  PixelSequence* lights;                    ///< sample points of direct light; none: the eye path's own
  TileFigures& figures;
  Tally& tally;
  /// Hit points so far. Where several share their statistics all bring flux, but only the first one's photons count in
  /// M, which decides how fast the radius shrinks: as if the path had not been split.
  std::size_t gathers = 0;

  void ray() { ++figures.rays; }
  void escape(const EyeWalk& walk) { tally.add_direct(environment_seen(integrator.scene_, walk) * direct_weight); }
  void emitter(const SurfacePoint& point, const Vec3f& wo, const EyeWalk& walk) {
    tally.add_direct(emission_seen(integrator.scene_, point, wo, walk) * direct_weight);
  }
  void first_hit(const Vertex& vertex, float distance) {
    if (features != nullptr) add_features(*features, integrator.film_.scale, vertex, distance);
  }
  void direct(const Vertex& vertex, float u_pick, const Vec2f& u, float p_follow, const EyeWalk& walk) {
    const float pick = lights != nullptr ? lights->next1() : u_pick;
    const Vec2f at = lights != nullptr ? lights->next2() : u;
    tally.add_direct(walk.beta * direct_weight *
                     direct_light(integrator.scene_, vertex, walk.media, pick, at, Portion::kFollow, p_follow,
                                  integrator.light_samples_, figures.rays));
  }
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk&) {
    if (weight == 0.0f) return;
    const std::size_t point = std::min(gathers, state.size() - 1);
    const bool steers = gathers++ == point;
    for (const Flow flow : {kCaustic, kIndirect}) gather_flow(flow, point, steers, vertex, beta * weight, u);
  }
  void gather_flow(Flow flow, std::size_t point, bool steers, const Vertex& vertex, const Rgb& beta, const Vec2f& u) {
    const DiscQuery query = query_at(vertex, state[point][flow].radius2 * ratio);
    std::uint32_t count = 0;
    Rgb flux = reflected_flux(photons[flow], query, vertex, count);
    if (count == 0) return;
    const bool with_bias = integrator.film_.extra == Extra::kBias;
    float moment = with_bias ? bias_moment(photons[flow], query, vertex, beta) : 0.0f;
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
  [[nodiscard]] Rgb reflected_flux(GatherCursor& photons, const DiscQuery& query, const Vertex& vertex,
                                   std::uint32_t& count) const {
    if (vertex.bsdf.gather_is_lambert()) {
      const FluxSum sum = photons.sum_flux(query);
      count = sum.count;
      const double step = integrator.tracer_.flux_unit() / kFluxSteps;
      return vertex.bsdf.lambert_f() * Rgb{static_cast<float>(static_cast<double>(sum.steps[0]) * step),
                                           static_cast<float>(static_cast<double>(sum.steps[1]) * step),
                                           static_cast<float>(static_cast<double>(sum.steps[2]) * step)};
    }
    const std::vector<std::uint32_t>& indices = found(photons, query);
    count = static_cast<std::uint32_t>(indices.size());
    Rgb sum{0.0f, 0.0f, 0.0f};
    for (const std::uint32_t i : indices) sum += reflected_photon(photons.tree(), i, vertex);
    return sum * static_cast<float>(integrator.tracer_.flux_unit());
  }
  [[nodiscard]] static const std::vector<std::uint32_t>& found(GatherCursor& photons, const DiscQuery& query) {
    thread_local std::vector<std::uint32_t> indices;
    indices.clear();
    photons.collect(query, indices);
    return indices;
  }
  /// One photon's part, in units of flux_unit().
  [[nodiscard]] static Rgb reflected_photon(const PhotonTree& tree, std::uint32_t i, const Vertex& vertex) {
    const Rgb f = vertex.bsdf.gather_is_lambert()
                      ? vertex.bsdf.lambert_f()
                      : vertex.bsdf.eval(vertex.wo, tree.towards_light(i), Transport::kRadiance, Portion::kGather);
    return f * tree.flux(i);
  }
  /// What the disc's bias is estimated from. With a flux density p + c d^2 around the middle, photons at distance d sum
  /// up to pi R^2 (p + c R^2/2), and weighed by 6 d^2/R^2 - 3 to pi R^2 * c R^2/2, the bias: the Laplacian of
  /// [Hachisuka, Jarosz and Jensen 2010, 4.2], by a quadratic kernel over the same disc. Of the luminance; apart from
  /// the flux, whose bits must not depend on whether anybody asks for its error.
  [[nodiscard]] float bias_moment(GatherCursor& photons, const DiscQuery& query, const Vertex& vertex,
                                  const Rgb& beta) const {
    float moment = 0.0f;
    for (const std::uint32_t i : found(photons, query)) {
      const Vec3f offset = photons.tree().position(i) - query.position;
      moment += luminance(beta * reflected_photon(photons.tree(), i, vertex)) *
                bias_weight(dot(offset, offset), query.radius2);
    }
    return moment * static_cast<float>(integrator.tracer_.flux_unit());
  }
};

ProgressiveMapping::EyeSamples ProgressiveMapping::eye_samples(std::size_t pixel, std::uint64_t sub_pass) const {
  if (sampling_.fixed > 0) return {0, sampling_.fixed};
  const std::uint64_t count = allocation_->samples(pixel);
  return {sub_pass * count, count};
}

void ProgressiveMapping::gather_pixel(int x, int y, std::uint64_t sub_pass, const std::vector<ProgressivePixel>& state,
                                      Cursors& photons, Statistics& sums, TileFigures& figures) const {
  const auto width = static_cast<std::size_t>(eye_.width());
  const std::size_t pixel = static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x);
  const std::size_t i = points() * pixel;
  const EyeSamples samples = eye_samples(pixel, sub_pass);
  Tally tally(sums.pixels[i], nullptr, film_.scale, figures.faults);
  PixelSequence lights = eye_.light_sequence(x, y, sub_pass);
  const double ratio =
      film_.estimator == Estimator::kIndependent ? independent_radius2_ratio(sub_pass, film_.alpha) : 1.0;
  RadianceSink sink{*this,
                    photons,
                    std::span(state).subspan(i, points()),
                    std::span(sums.pixels).subspan(i, points()),
                    sums.extras.empty() ? std::span<ExtraSums>() : std::span(sums.extras).subspan(i, points()),
                    static_cast<float>(ratio),
                    1.0f / static_cast<float>(samples.count),
                    0.0f,
                    nullptr,
                    sampling_.fixed > 0 ? &lights : nullptr,
                    figures,
                    tally};
  const EyePaths eye_paths(scene_, eye_, max_depth_);
  const bool fixed = sampling_.fixed > 0;
  const std::uint64_t shown = fixed ? sub_pass % sampling_.fixed : samples.first;
  for (std::uint64_t sample = samples.first; sample < samples.first + samples.count; ++sample) {
    sink.weight = fixed ? sink.direct_weight : sample == samples.first ? 1.0f : 0.0f;
    sink.features = sub_pass < kFeatureSubPasses && sample == shown ? &sums.features[i] : nullptr;
    eye_paths.follow(x, y, sample, sink);
  }
  tally.commit();
}

void ProgressiveMapping::run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const {
  if (sampling_.fixed == 0) {
    std::call_once(allocating_, [&] { allocation_.emplace(scene_, eye_, max_depth_, light_samples_); });
  }
  for (std::uint64_t s = unit.first_sub_pass; s < unit.first_sub_pass + unit.sub_passes; ++s) {
    PhotonBatch batch = tracer_.trace(s);
    sums.photon_paths += tracer_.options().paths;
    for (const Photons& photons : batch.flows) sums.photons_stored += photons.size();
    sums.rays += batch.rays;
    sums.faults += batch.faults;
    const Trees trees = build_trees(std::move(batch));
    for_each_tile(eye_.width(), eye_.height(), sums, [&](const Tile& tile, TileFigures& figures) {
      Cursors photons{GatherCursor(trees[kCaustic]), GatherCursor(trees[kIndirect])};
      for (int y = tile.y0; y < tile.y1; ++y) {
        // There and back again: each pixel lies beside the one before, and the cursors meet nearly the same photons.
        const bool back = (y - tile.y0) % 2 != 0;
        for (int k = 0; k < tile.x1 - tile.x0; ++k) {
          gather_pixel(back ? tile.x1 - 1 - k : tile.x0 + k, y, s, state, photons, sums, figures);
        }
      }
    });
    ++sums.sub_passes;
  }
}

}  // namespace pf
