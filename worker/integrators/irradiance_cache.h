#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "worker/integrators/gather_rays.h"
#include "worker/integrators/irradiance_builder.h"
#include "worker/integrators/irradiance_store.h"
#include "worker/integrators/map_estimate.h"
#include "worker/integrators/photon_map.h"
#include "worker/integrators/single_pass.h"
#include "worker/photon/irradiance_cache.h"

namespace pf {

/// Irradiance caching: indirect light on diffuse surfaces is gathered at few points and interpolated between
/// them.
///
/// Ward, Rubinstein, Clear 1988, "A Ray Tracing Solution for Diffuse Interreflection"; Ward and Heckbert
/// 1992, "Irradiance Gradients"; Krivanek and Gautron 2009, "Practical Global Illumination with Irradiance
/// Caching". Before the first sample an overture makes the records that the image will read
/// (IrradianceBuilder); from then on the cache does not change. Light that arrives at a gather point is the
/// cache's irradiance times the Lambert lobe, where the gather portion is one; rough reflections follow
/// gather rays of their own, one a sample. Gather rays end in the global photon map or go on as paths. Direct
/// light is sampled, caustics come from the caustic map.
///
/// Bias: of the interpolated irradiance about `error` times its own change over a record's radius; indirect
/// light that changes within `min_spacing` pixels is blurred. Records' noise stays, as soft patches: more
/// `rays` make it smaller. A sample that no record reaches (a new surface seen through an antialiased edge or
/// deep in a mirror) gathers for itself, without bias. Where it fails: fine normal maps and foliage, where
/// hardly two points share a record; strongly directional indirect light on glossy surfaces, which is left to
/// single rays.
///
/// `cache.file` keeps records from run to run: another view adds to them, and after the scene changed those
/// that the change can have touched are gathered again (changed_part says how that is told, and what error
/// may stay). An image then depends on what the file held.
class IrradianceCacheIntegrator final : public SinglePassIntegrator {
 public:
  /// `parts`: of the scene (scene_parts), needed with `cache.file` only.
  IrradianceCacheIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec,
                            std::vector<ScenePart> parts = {});

  [[nodiscard]] std::vector<std::string> warnings() const override;

  [[nodiscard]] const IrradianceCache& cache() const { return cache_; }
  [[nodiscard]] const IrradianceFigures& figures() const { return builder_.figures(); }
  /// Why the cache file was not used, if so.
  [[nodiscard]] const std::optional<Error>& file_error() const { return store_.error(); }
  /// Eye samples so far that no record reached, and the gather rays of each.
  [[nodiscard]] std::uint64_t misses() const { return misses_; }
  [[nodiscard]] std::uint64_t rays_of_miss() const { return miss_grid_.cells(); }

 private:
  using Sink = FourPartSink<const IrradianceCacheIntegrator>;
  friend Sink;
  void render(const PixelTarget& target) const override;
  void prepare(const ImagePart& part) const override;
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk& walk, const Sink::Layers& to) const;
  [[nodiscard]] Rgb irradiance(const Vertex& vertex, const EyeWalk& walk, const PixelTarget& target) const;
  void fill_cache();

  std::uint64_t seed_;
  TileFigures made_;  ///< what making the maps took; counted with the first pixel's first sample
  std::unique_ptr<const GatherRadiance> source_;
  MapEstimate caustics_;
  IrradianceStore store_;
  IrradianceBuilder builder_;
  HemisphereGrid miss_grid_;
  IrradianceCache cache_;
  std::vector<std::uint16_t> marks_;              ///< records made at each pixel
  mutable CoveredRadii covered_;                  ///< for the caustics' discs
  mutable std::atomic<std::uint64_t> misses_{0};  ///< a figure; no image depends on it
};

}  // namespace pf
