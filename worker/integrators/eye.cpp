#include "worker/integrators/eye.h"

#include <mutex>

#include "common/base/parallel.h"

namespace pf {

Eye::Eye(const Scene& scene, const Camera& camera, int width, int height, std::uint64_t seed)
    : camera_(camera, width, height),
      media_(scene.media_around(camera_.position())),
      width_(width),
      height_(height),
      seed_(seed) {}

PixelSequence Eye::sequence(int x, int y, std::uint64_t sample, std::uint32_t purpose) const {
  const auto pixel = static_cast<std::uint32_t>(y) * static_cast<std::uint32_t>(width_) + static_cast<std::uint32_t>(x);
  // Sequences are 32 bits long; a job that goes on beyond starts another one.
  std::uint32_t h = combine_hash(static_cast<std::uint32_t>(seed_), static_cast<std::uint32_t>(seed_ >> 32));
  h = combine_hash(h, static_cast<std::uint32_t>(sample >> 32));
  if (purpose != 0) h = combine_hash(h, purpose);
  return {combine_hash(h, pixel), static_cast<std::uint32_t>(sample)};
}

PixelSequence Eye::light_sequence(int x, int y, std::uint64_t sub_pass) const { return sequence(x, y, sub_pass, 1); }

Eye::Start Eye::start(int x, int y, std::uint64_t sample) const {
  PixelSequence sequence = this->sequence(x, y, sample, 0);
  const Vec2f film = sequence.next2() + Vec2f{static_cast<float>(x), static_cast<float>(y)};
  const Vec2f lens = camera_.has_lens() ? sequence.next2() : Vec2f{0.5f, 0.5f};
  const CameraRays::Generated ray = camera_.ray(film, lens);
  return {sequence, Ray{ray.origin, ray.direction}};
}

void add_features(FeatureSums& sums, const SumScale& scale, const Vertex& vertex, float distance) {
  const Rgb albedo = vertex.bsdf.albedo(Portion::kAll);
  const Vec3f& normal = vertex.bsdf.ns();
  for (int c = 0; c < 3; ++c) {
    const auto i = static_cast<std::size_t>(c);
    const auto steps_of = [](float value) { return static_cast<std::int16_t>(std::lrint(value / SumScale::kUnit)); };
    sums.albedo[i] = static_cast<std::int16_t>(sums.albedo[i] + steps_of(std::clamp(albedo[c], 0.0f, 1.0f)));
    sums.normal[i] = static_cast<std::int16_t>(sums.normal[i] + steps_of(normal[c]));
  }
  sums.add_depth(distance / scale.depth);
}

SumScale scale_of_scene(const Scene& scene, double photon_flux) {
  const Vec3f size = scene.bounds().size();
  const double area = 2.0 * (double{size.x} * size.y + double{size.y} * size.z + double{size.z} * size.x);
  const double flux = average(scene.lights().total_flux());
  return SumScale::from_scene(area > 0.0 ? flux / (double{kPi} * area) : 1.0, photon_flux, length(size));
}

void Tally::commit() {
  bool exact = add_quantised(sums_.direct, direct_, scale_.radiance);
  Rgb all = direct_;
  for (std::size_t f = 0; f < kFlows; ++f) {
    if (is_zero(flow_[f])) continue;
    exact = add_quantised(sums_.flow[f], flow_[f], scale_.flow) && exact;
    all += flow_[f];
  }
  if (extra_ != nullptr && !is_zero(specular_)) {
    exact = add_quantised(extra_->rgb, specular_, scale_.radiance) && exact;
    all += specular_;
  }
  if (!exact) ++faults_.overflow;
  // The square only feeds the error estimate: where it leaves its range, it stays out.
  const double l = luminance(all);
  static_cast<void>(add_quantised(sums_.square, l * l, scale_.square));
}

TileFigures& TileFigures::operator+=(const TileFigures& o) {
  rays += o.rays;
  photon_paths += o.photon_paths;
  photons_stored += o.photons_stored;
  faults += o.faults;
  return *this;
}

void for_each_tile(int width, int height, Statistics& total,
                   const std::function<void(const Tile& tile, TileFigures& figures)>& visit) {
  for_each_tile(Tile{0, 0, width, height}, total, visit);
}

void for_each_tile(const Tile& region, Statistics& total,
                   const std::function<void(const Tile& tile, TileFigures& figures)>& visit) {
  const int columns = (region.x1 - region.x0 + kTileEdge - 1) / kTileEdge;
  const int rows = (region.y1 - region.y0 + kTileEdge - 1) / kTileEdge;
  std::mutex adding;
  TileFigures all;
  parallel_for(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), [&](std::size_t tile) {
    const int index = static_cast<int>(tile);
    TileFigures figures;
    const int x0 = region.x0 + index % columns * kTileEdge;
    const int y0 = region.y0 + index / columns * kTileEdge;
    visit({x0, y0, std::min(region.x1, x0 + kTileEdge), std::min(region.y1, y0 + kTileEdge)}, figures);
    const std::lock_guard lock(adding);
    all += figures;
  });
  total.rays += all.rays;
  total.photon_paths += all.photon_paths;
  total.photons_stored += all.photons_stored;
  total.faults += all.faults;
}

void for_each_pixel(int width, int height, Statistics& total,
                    const std::function<void(int x, int y, TileFigures& figures)>& visit) {
  for_each_tile(width, height, total, [&](const Tile& tile, TileFigures& figures) {
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) visit(x, y, figures);
    }
  });
}

}  // namespace pf
