#include "worker/integrators/final_gather.h"

#include <algorithm>

namespace pf {
namespace {

/// Rays of a sample that interpolates nothing, as a part of those of a gather point: many samples share a
/// pixel.
constexpr int kSampleShare = 8, kFewestRays = 16;
/// Of a sample on a rough lobe.
constexpr int kLobeShare = 16;

}  // namespace

FinalGatherIntegrator::FinalGatherIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec)
    : SinglePassIntegrator(scene, camera, spec, Extra::kGatherPoints),
      rays_(spec.final_gather.rays),
      interpolate_(spec.final_gather.error > 0.0),
      seed_(spec.integrator.seed),
      map_(scene, spec),
      hemisphere_(map_, spec),
      covered_(scene_, eye_, max_depth_),
      points_(scene_, eye_, hemisphere_, spec) {
  const TracedPhotons caustics(scene, spec, TracedPhotons::Purpose::kCaustics, spec.integrator.max_depth);
  const Photons* flows[] = {&caustics.batch.flows[kCaustic]};
  caustics_ = MapEstimate(scene, flows, caustics.flux_unit, caustic_options(spec));
  photon_figures_ = map_.figures();
  photon_figures_ += caustics.figures();
}

void FinalGatherIntegrator::prepare(const ImagePart& part) const {
  if (!caustics_.empty()) covered_.find(part, caustics_.max_distance());
  if (interpolate_) points_.place(part);
}

/// Adds indirect light and caustics at the end of an eye path.
struct FinalGatherIntegrator::Gather {
  const FinalGatherIntegrator& integrator;
  const PixelTarget& target;
  std::uint32_t gathers = 0;  ///< of this sample so far

  template <typename Layers>
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk& walk, const Layers& to) {
    if (!integrator.caustics_.empty()) {
      const float covered = integrator.covered_.at(target.x, target.y);
      to.add_flow(kCaustic, beta * integrator.caustics_.radiance(integrator.scene_, vertex, Portion::kGather, covered,
                                                                 u, target.figures));
    }
    // Every gather of every sample has random numbers of its own: the image's points use small numbers for
    // the sub-pass.
    constexpr std::uint64_t kSamples = std::uint64_t{1} << 24;
    const auto pixel = static_cast<std::uint32_t>(target.y) * static_cast<std::uint32_t>(integrator.eye_.width()) +
                       static_cast<std::uint32_t>(target.x);
    PathRng rng(integrator.seed_, Stream::kIrradiance, kSamples + target.sample * 256 + gathers++, pixel);
    to.add_flow(kIndirect,
                beta * (vertex.bsdf.gather_is_lambert() ? lambert(vertex, walk, rng) : lobe(vertex, walk, rng)));
  }

  Rgb lambert(const Vertex& vertex, const EyeWalk& walk, PathRng& rng) const {
    Rgb irradiance;
    const bool known = integrator.interpolate_ && walk.bounce == 0 &&
                       integrator.points_.interpolate(target.x, target.y, vertex, irradiance);
    if (!known) {
      const int few = std::min(integrator.rays_, std::max(kFewestRays, integrator.rays_ / kSampleShare));
      const int rays = integrator.interpolate_ ? few : integrator.rays_;
      irradiance = integrator.hemisphere_.at(vertex, walk.media, rays, rng, target.figures).irradiance;
    }
    return vertex.bsdf.lambert_f() * irradiance;
  }

  Rgb lobe(const Vertex& vertex, const EyeWalk& walk, PathRng& rng) const {
    const int rays = std::max(1, integrator.rays_ / kLobeShare);
    Rgb sum{0.0f, 0.0f, 0.0f};
    for (int i = 0; i < rays; ++i) {
      const float u_lobe = (static_cast<float>(i) + rng.next1()) / static_cast<float>(rays);
      const auto next = vertex.bsdf.sample(vertex.wo, std::min(u_lobe, kOneMinusEpsilon), rng.next2(),
                                           Transport::kRadiance, Portion::kGather);
      if (!next) continue;
      MediumStack media = walk.media;
      if (next->refracted) media.cross(vertex.point.material, vertex.entering());
      const Ray ray{offset_past(vertex.point, next->wi), next->wi};
      sum += next->weight * integrator.map_.arriving(ray, media, rng, target.figures).radiance;
    }
    return sum / static_cast<float>(rays);
  }
};

void FinalGatherIntegrator::render(const PixelTarget& target) const {
  if (target.sample == 0) {
    if (target.x == 0 && target.y == 0) target.figures += photon_figures_;
    if (interpolate_) {
      if (points_.marked(target.x, target.y)) target.tally.mark();
      target.figures += points_.figures_at(target.x, target.y);
    }
  }
  Gather method{*this, target};
  FourPartSink<Gather> sink(scene_, film_.scale, light_samples_, target, method);
  EyePaths(scene_, eye_, max_depth_).follow(target.x, target.y, target.sample, sink);
}

}  // namespace pf
