#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "common/math/vec.h"
#include "worker/scene/lights.h"
#include "worker/scene/medium_stack.h"
#include "worker/scene/scene.h"

namespace pf {

/// Where a photon's path starts, and through what.
struct PhotonStart {
  Vec3f position{0, 0, 0};  ///< where the way through a medium counts from: the lamp itself, or the ray's origin
  MediumStack media;
  Rgb texture{1, 1, 1};  ///< the lamp's emission there, in its mean
};

/// Of a ray that a light emitted from `origin`; `triangle` negative: not from a triangle.
[[gnu::always_inline]] inline PhotonStart photon_start(const Scene& scene, const Vec3f& origin, int triangle,
                                                       const Vec2f& barycentric) {
  PhotonStart start;
  start.position = origin;
  if (triangle >= 0) {
    const auto index = static_cast<std::uint32_t>(triangle);
    const Vec2f& b = barycentric;
    start.texture = scene.emission_ratio(index, b);
    const std::span<const int> around = scene.media_of_emitter(index);
    if (around.empty()) return start;
    start.media = MediumStack(around);
    const EmissiveTriangle& lamp = scene.lights().triangle(index);
    start.position = lamp.p0 * (1.0f - b.x - b.y) + lamp.p1 * b.x + lamp.p2 * b.y;
  } else if (scene.any_medium()) {
    start.media = MediumStack(scene.media_around(origin));
  }
  return start;
}

/// Russian roulette on the largest channel keeps photons whole [Jensen 2001, 5.2.4]: the probability with
/// which a photon went on after a bounce of this weight, its flux then being what goes on; 0 where it did
/// not.
[[gnu::always_inline]] inline float roulette(Rgb& flux, const Rgb& weight, float u) {
  const Rgb left = flux * weight;
  const float survival = std::min(1.0f, max_component(left) / max_component(flux));
  if (!(u < survival)) return 0.0f;
  flux = survival < 1.0f ? left / survival : left;
  return survival;
}

}  // namespace pf
