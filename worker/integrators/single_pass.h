#pragma once

#include <cstdint>
#include <vector>

#include "common/film/pass_order.h"
#include "common/spec/job_spec.h"
#include "worker/integrators/eye.h"
#include "worker/integrators/eye_paths.h"
#include "worker/integrators/integrator.h"

namespace pf {

/// Where one eye sample of one pixel goes.
struct PixelTarget {
  int x = 0, y = 0;
  std::uint64_t sample = 0;
  Tally& tally;
  FeatureSums* features;  ///< none for samples past kFeatureSubPasses
  TileFigures& figures;
};

/// Film of a method whose pixels are plain means of samples.
[[nodiscard]] FilmOptions film_of_samples(const Scene& scene, const JobSpec& spec, Extra extra);

/// What the methods of photon mapping before its progressive forms have in common: structures made once from the scene
/// (photon maps, caches), then eye samples that read them. A sub-pass is a tile of the image (PassOrder), so that a
/// farm gives tiles to workers; each worker makes the structures from the same seeds, and they are the same to the bit.
class SinglePassIntegrator : public Integrator {
 public:
  [[nodiscard]] FilmOptions film_options() const override { return film_; }
  [[nodiscard]] std::vector<ProgressivePixel> initial_radii() const override { return {}; }
  void run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const override;

 protected:
  SinglePassIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec, Extra extra);
  /// Adds one eye sample to its pixel; called by many threads at once.
  virtual void render(const PixelTarget& target) const = 0;
  /// Called by one thread before a part of the image is rendered, for what its samples share. Must not change what any
  /// sample gives (only when it is computed).
  virtual void prepare(const ImagePart& part) const { static_cast<void>(part); }

  const Scene& scene_;
  Eye eye_;
  FilmOptions film_;
  int max_depth_;
  int light_samples_;
};

/// Sends what an eye path meets to the layers of the four-part split [Jensen 1996, 4]: what is seen through a sharp
/// reflection or refraction is specular, the rest direct, caustics or indirect. `Method` brings
///   void gather(const Vertex&, const Rgb& beta, const Vec2f& u, const EyeWalk&, Layers& to)
/// and adds light that arrives by more than one segment to `to`.
template <typename Method>
class FourPartSink {
 public:
  /// Where light of the present vertex goes.
  struct Layers {
    const PixelTarget& target;
    bool specular;  ///< seen through a sharp reflection or refraction
    void add_direct(const Rgb& radiance) const {
      specular ? target.tally.add_specular(radiance) : target.tally.add_direct(radiance);
    }
    void add_flow(Flow flow, const Rgb& radiance) const {
      specular ? target.tally.add_specular(radiance) : target.tally.add_flow(flow, radiance);
    }
  };

  /// `light_samples`: of direct light at a vertex.
  FourPartSink(const Scene& scene, const SumScale& scale, int light_samples, const PixelTarget& target, Method& method)
      : scene_(scene), scale_(scale), light_samples_(light_samples), target_(target), method_(method) {}

  void ray() { ++target_.figures.rays; }
  void escape(const EyeWalk& walk) { layers(walk).add_direct(environment_seen(scene_, walk)); }
  void emitter(const SurfacePoint& point, const Vec3f& wo, const EyeWalk& walk) {
    layers(walk).add_direct(emission_seen(scene_, point, wo, walk));
  }
  void first_hit(const Vertex& vertex, float distance) {
    if (target_.features != nullptr) add_features(*target_.features, scale_, vertex, distance);
  }
  void direct(const Vertex& vertex, float u_pick, const Vec2f& u, float p_follow, const EyeWalk& walk) {
    layers(walk).add_direct(walk.beta * direct_light(scene_, vertex, walk.media, u_pick, u, Portion::kFollow, p_follow,
                                                     light_samples_, target_.figures.rays));
  }
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk& walk) {
    method_.gather(vertex, beta, u, walk, layers(walk));
  }

 private:
  [[nodiscard]] Layers layers(const EyeWalk& walk) const { return {target_, walk.bounce > 0}; }

  const Scene& scene_;
  const SumScale& scale_;
  int light_samples_;
  const PixelTarget& target_;
  Method& method_;
};

}  // namespace pf
