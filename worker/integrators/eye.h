#pragma once

#include <cstdint>
#include <functional>

#include "common/film/statistics.h"
#include "common/math/owen_sobol.h"
#include "worker/integrators/direct_light.h"
#include "worker/scene/camera_rays.h"
#include "worker/scene/medium_stack.h"
#include "worker/scene/scene.h"

namespace pf {

/// Size of the tiles in which pixels are handed to threads: neighbours gather from the same photons.
inline constexpr int kTileEdge = 16;

/// The eye's side of every algorithm: camera, pixels and their sequences of sample points.
class Eye {
 public:
  Eye(const Scene& scene, const Camera& camera, int width, int height, std::uint64_t seed);

  /// A ray through the pixel; the sequence goes on with the dimensions after film and lens.
  struct Start {
    PixelSequence sequence;
    Ray ray;
  };
  [[nodiscard]] Start start(int x, int y, std::uint64_t sample) const;
  /// A sequence for direct light of eye paths that stay the same from sub-pass to sub-pass.
  [[nodiscard]] PixelSequence light_sequence(int x, int y, std::uint64_t sub_pass) const;
  [[nodiscard]] const CameraRays& camera() const { return camera_; }
  [[nodiscard]] const MediumStack& media() const { return media_; }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }

 private:
  [[nodiscard]] PixelSequence sequence(int x, int y, std::uint64_t sample, std::uint32_t purpose) const;

  CameraRays camera_;
  MediumStack media_;  ///< volumes that the camera stands in
  int width_, height_;
  std::uint64_t seed_;
};

/// Adds the first hit's albedo, normal and depth.
void add_features(FeatureSums& sums, const SumScale& scale, const Vertex& vertex, float distance);

/// Fixed-point steps of a scene: reference radiance is emitted flux / (pi * area of the scene's bounds).
[[nodiscard]] SumScale scale_of_scene(const Scene& scene, double photon_flux);

/// A pixel's tally of one sub-pass, added to its exact sums at the end.
class Tally {
 public:
  /// `extra`: null for methods without a layer of their own.
  Tally(PixelSums& sums, ExtraSums* extra, const SumScale& scale, Faults& faults)
      : sums_(sums), extra_(extra), scale_(scale), faults_(faults) {}
  void add_direct(const Rgb& radiance) { add(direct_, radiance); }
  void add_flow(Flow flow, const Rgb& radiance) { add(flow_[flow], radiance); }
  /// Light seen through sharp reflections or refractions; needs `extra`.
  void add_specular(const Rgb& radiance) { add(specular_, radiance); }
  /// Something was placed at this pixel (Extra says what); needs `extra`.
  void mark() { ++extra_->marks; }
  /// Writes radiance sums, and the square of the luminance of all that was added.
  void commit();

 private:
  void add(Rgb& sum, const Rgb& radiance) {
    if (is_finite(radiance)) {
      sum += radiance;
    } else {
      ++faults_.not_finite;
    }
  }
  PixelSums& sums_;
  ExtraSums* extra_;
  const SumScale& scale_;
  Faults& faults_;
  Rgb direct_{0, 0, 0};
  Rgb specular_{0, 0, 0};
  std::array<Rgb, kFlows> flow_{Rgb{0, 0, 0}, Rgb{0, 0, 0}};
};

/// Figures of one tile; the sheets are added up (integers: no order).
struct TileFigures {
  std::uint64_t rays = 0;
  std::uint64_t photon_paths = 0, photons_stored = 0;
  Faults faults;
  TileFigures& operator+=(const TileFigures& o);
};
struct Tile {
  int x0, y0, x1, y1;  ///< the last ones are outside
};
/// Calls `visit(tile, figures)` for every tile of a region, in parallel.
void for_each_tile(const Tile& region, Statistics& total,
                   const std::function<void(const Tile& tile, TileFigures& figures)>& visit);
/// The same for the whole image.
void for_each_tile(int width, int height, Statistics& total,
                   const std::function<void(const Tile& tile, TileFigures& figures)>& visit);
/// Calls `visit(x, y, figures)` for every pixel, in parallel by tiles.
void for_each_pixel(int width, int height, Statistics& total,
                    const std::function<void(int x, int y, TileFigures& figures)>& visit);

}  // namespace pf
