#include "worker/integrators/irradiance_cache.h"

#include <algorithm>
#include <utility>

#include "worker/integrators/gather_path.h"

namespace pf {
namespace {

/// Rays of a hemisphere at an eye sample that no record reaches, as a part of a usual record's: half of the finest
/// record's, since the pixel's other samples share them.
constexpr int kMissShare = 16;
constexpr int kLeastMissRays = 16;

/// Names the random numbers of one eye path's gather rays. Records' streams lie below 2^32, those of updates
/// above 2^46; longer jobs and larger images than these bits hold use numbers twice.
std::uint64_t stream_of(std::uint64_t pixel, std::uint64_t sample, const EyeWalk& walk) {
  const auto branch = static_cast<std::uint64_t>(walk.splits + walk.bounce) & 7u;
  return (1ull << 47) | (((pixel << 19) ^ (sample << 3) ^ branch) & ((1ull << 47) - 1));
}

std::unique_ptr<const GatherRadiance> make_source(const Scene& scene, const JobSpec& spec, TileFigures& made) {
  if (spec.irradiance_cache.source == GatherSource::kPath)
    return std::make_unique<PathGather>(scene, spec.integrator.max_depth);
  auto source = std::make_unique<MapGather>(scene, spec);
  made = source->figures();
  return source;
}

}  // namespace

IrradianceCacheIntegrator::IrradianceCacheIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec,
                                                     std::vector<ScenePart> parts)
    : SinglePassIntegrator(scene, camera, spec, Extra::kCacheRecords),
      seed_(spec.integrator.seed),
      source_(make_source(scene, spec, made_)),
      store_(spec, camera, std::move(parts)),
      builder_(scene, *source_, spec.irradiance_cache, store_.seed()),
      miss_grid_(HemisphereGrid::of_rays(std::max(kLeastMissRays, spec.irradiance_cache.rays / kMissShare))),
      cache_(scene.bounds(), static_cast<float>(spec.irradiance_cache.error)),
      marks_(static_cast<std::size_t>(spec.image.width) * static_cast<std::size_t>(spec.image.height)),
      covered_(scene_, eye_, max_depth_) {
  const TracedPhotons photons(scene, spec, TracedPhotons::Purpose::kCaustics, spec.integrator.max_depth);
  const Photons* flows[] = {&photons.batch.flows[kCaustic]};
  caustics_ = MapEstimate(scene, flows, photons.flux_unit, caustic_options(spec));
  made_ += photons.figures();
  fill_cache();
}

void IrradianceCacheIntegrator::fill_cache() {
  IrradianceFile& content = store_.content();
  builder_.update(content, store_.change(), max_depth_, cache_);
  if (!store_.holds_view()) {
    builder_.overture(eye_, max_depth_, cache_, content.next_id, marks_, store_.keeps() ? &content.reaches : nullptr);
    content.records = cache_.records();
    if (store_.keeps()) store_.write();
  }
  // The octree as a reader of the file would build it: the same sums in the same order.
  cache_.assign(std::move(content.records));
  content = {};
}

void IrradianceCacheIntegrator::prepare(const ImagePart& part) const {
  if (!caustics_.empty()) covered_.find(part, caustics_.max_distance());
}

void IrradianceCacheIntegrator::render(const PixelTarget& target) const {
  if (target.x == 0 && target.y == 0 && target.sample == 0) {
    target.figures += made_;
    target.figures.rays += figures().rays;
    target.figures.faults += figures().faults;
  }
  Sink sink(scene_, film_.scale, light_samples_, target, *this);
  EyePaths(scene_, eye_, max_depth_).follow(target.x, target.y, target.sample, sink);
  if (target.sample > 0) return;
  const std::size_t pixel =
      static_cast<std::size_t>(target.y) * static_cast<std::size_t>(film_.width) + static_cast<std::size_t>(target.x);
  for (int i = 0; i < marks_[pixel]; ++i) target.tally.mark();
}

Rgb IrradianceCacheIntegrator::irradiance(const Vertex& vertex, const EyeWalk& walk, const PixelTarget& target) const {
  if (const auto read = cache_.interpolate(vertex.point.position, vertex.bsdf.ns())) return *read;
  ++misses_;
  const auto pixel = static_cast<std::uint64_t>(target.y) * static_cast<std::uint64_t>(film_.width) +
                     static_cast<std::uint64_t>(target.x);
  const GatherPlace place(vertex, walk.media, 0.0f);
  const HemisphereSamples samples =
      builder_.gather(place, miss_grid_, stream_of(pixel, target.sample, walk), target.figures);
  return estimate_irradiance(samples, Frame::from_normal(place.normal)).irradiance;
}

void IrradianceCacheIntegrator::gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk& walk,
                                       const Sink::Layers& to) const {
  const Bsdf& bsdf = vertex.bsdf;
  if (!caustics_.empty()) {
    const float covered = covered_.at(to.target.x, to.target.y);
    to.add_flow(kCaustic, beta * caustics_.radiance(scene_, vertex, Portion::kGather, covered, u, to.target.figures));
  }
  if (bsdf.gather_is_lambert()) {
    if (!is_zero(bsdf.lambert_f()))
      to.add_flow(kIndirect, beta * bsdf.lambert_f() * irradiance(vertex, walk, to.target));
    return;
  }
  PixelSequence sequence = walk.sequence;
  const float u_lobe = sequence.next1();
  const auto next = bsdf.sample(vertex.wo, u_lobe, u, Transport::kRadiance, Portion::kGather);
  if (!next) return;
  MediumStack media = walk.media;
  if (next->refracted) media.cross(vertex.point.material, vertex.entering());
  const auto pixel = static_cast<std::uint64_t>(to.target.y) * static_cast<std::uint64_t>(film_.width) +
                     static_cast<std::uint64_t>(to.target.x);
  PathRng rng(seed_, Stream::kIrradiance, stream_of(pixel, to.target.sample, walk), 0);
  const auto arrival =
      source_->arriving({offset_past(vertex.point, next->wi), next->wi}, media, rng, to.target.figures);
  to.add_flow(kIndirect, beta * next->weight * arrival.radiance);
}

std::vector<std::string> IrradianceCacheIntegrator::warnings() const {
  if (!file_error()) return {};
  return {"cache.file: " + file_error()->message + "; the file is left as it is, and all records were made anew"};
}

}  // namespace pf
