#pragma once

#include <cstdint>

#include "common/math/vec.h"
#include "worker/bsdf/bsdf.h"
#include "worker/scene/medium_stack.h"
#include "worker/scene/scene.h"

namespace pf {

/// Surface point at which an eye path scatters.
struct Vertex {
  SurfacePoint point;
  Vec3f wo;
  SurfaceParams params;
  Bsdf bsdf;
  bool transmissive;  ///< light from behind can contribute

  Vertex(const Scene& scene, const SurfacePoint& p, const Vec3f& direction_back, const MediumStack& media)
      : point(p),
        wo(direction_back),
        params(scene.evaluate(p, media.eta_outside(scene, p.material, dot(direction_back, p.ng) > 0.0f))),
        bsdf(params, direction_back),
        transmissive(params.transmission > 0.0f) {}
  [[nodiscard]] bool entering() const { return dot(wo, point.ng) > 0.0f; }
};

/// How the path that arrives at an emitter was sampled, to weigh it against next-event estimation.
struct BsdfTechnique {
  bool delta = true;  ///< camera ray or Dirac lobe: no other technique finds the light
  float pdf_w = 0;
  Vec3f position{0, 0, 0};  ///< vertex that the direction was sampled at; the lens for a camera ray
  Vec3f normal{0, 0, 0};
  bool transmissive = false;
};

/// Radiance reflected at `vertex` from one light sample, by next-event estimation over all lights with multiple
/// importance sampling [Veach 1997, 9.2] against following the BSDF: the path goes on with probability
/// `follow_probability` along a direction of `followed`.
[[nodiscard]] Rgb direct_light(const Scene& scene, const Vertex& vertex, const MediumStack& media, float u_pick,
                               const Vec2f& u, Portion followed, float follow_probability, std::uint64_t& rays);

/// The mean of `samples` such samples, each from its own part of all that u_pick chooses among and with u moved on:
/// stratified over the lamps, and over each of them [Shirley, Wang and Zimmerman 1996, "Monte Carlo Techniques for
/// Direct Lighting Calculations"]. One sample: the same as above.
[[nodiscard]] Rgb direct_light(const Scene& scene, const Vertex& vertex, const MediumStack& media, float u_pick,
                               const Vec2f& u, Portion followed, float follow_probability, int samples,
                               std::uint64_t& rays);

/// Weight of light emitted at `point` towards a path that sampled its way there.
[[nodiscard]] float emitter_weight(const Scene& scene, const SurfacePoint& point, const BsdfTechnique& technique);
/// Same for the environment met in direction `d`.
[[nodiscard]] float environment_weight(const Scene& scene, const Vec3f& d, const BsdfTechnique& technique);

}  // namespace pf
