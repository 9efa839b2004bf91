#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/math/vec.h"
#include "worker/scene/environment.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// One emissive triangle in world space. `radiance` is Le averaged over its texture (for choosing); the exact Le at a
/// point is asked from the scene by the callback given to Lights.
struct EmissiveTriangle {
  Vec3f p0, p1, p2;
  Vec3f ng;                    ///< unit, front side
  Rgb radiance;
  bool two_sided = false;
  std::uint32_t geometry = 0;  ///< ids that Scene uses to look the emitter up again
  std::uint32_t primitive = 0;
};

/// A sample of light arriving at a point (next-event estimation).
struct LightSample {
  Vec3f wi;                    ///< unit, towards the light
  float distance = 0;          ///< metres to the sampled point; kInfinity for directional lights and environment
  Rgb radiance;                ///< Le, or I/d^2 respectively E for delta lights (then pdf_w counts only the choice)
  float pdf_w = 0;             ///< per steradian, probability of choosing this light included
  bool delta = false;          ///< point, spot, directional: no other technique can find it
};

/// The start of a photon path.
struct Emission {
  Vec3f origin;                ///< on the light (already offset off the surface), or on a disc outside the scene
  Vec3f direction;             ///< unit
  Rgb flux;                    ///< W carried by the path if it were the only one: emitted radiance * cos / pdf
  std::uint32_t light = 0;     ///< index, for figures per light
};

/// Every light of a scene: emissive triangles, punctual lights, environment.
/// Choice for next-event estimation is by estimated contribution at the point: a light tree with orientation cones
/// [Conty Estevez and Kulla 2018; pbrt-v4 12.6.3]. Choice for emission is by flux.
class Lights {
 public:
  /// `triangles`: all emissive triangles. `bounds`: of the scene (disc for directional lights and environment).
  Lights(std::vector<EmissiveTriangle> triangles, std::vector<PunctualLight> punctual, const EnvironmentMap* environment,
         const Box3f& bounds);

  /// Samples light arriving at `p` on a surface with normal `n` (both hemispheres count when `transmissive`).
  /// Occlusion is the caller's. Empty when no light can contribute. For a triangle, radiance is that of the triangle
  /// (its textured value: the caller multiplies, see triangle()).
  struct Picked { LightSample sample; std::int32_t triangle = -1; Vec2f barycentric; };
  [[nodiscard]] std::optional<Picked> sample(const Vec3f& p, const Vec3f& n, bool transmissive, float u_pick,
                                             const Vec2f& u) const;
  /// Density per steradian with which sample() from (p, n) returns the point `q` of emissive triangle `index`.
  [[nodiscard]] float pdf_w(const Vec3f& p, const Vec3f& n, bool transmissive, std::uint32_t index, const Vec3f& q) const;
  /// Same for the environment in direction `wi`.
  [[nodiscard]] float pdf_w_environment(const Vec3f& p, const Vec3f& n, bool transmissive, const Vec3f& wi) const;

  /// Starts a photon path: u_pick chooses the light by flux, `u_position` and `u_direction` the ray.
  struct EmissionPicked { Emission emission; std::int32_t triangle = -1; Vec2f barycentric; };
  [[nodiscard]] std::optional<EmissionPicked> emit(float u_pick, const Vec2f& u_position, const Vec2f& u_direction) const;

  /// Sum over all lights of the emitted flux [W] (into the scene's bounds for directional lights and environment).
  [[nodiscard]] const Rgb& total_flux() const { return total_flux_; }
  [[nodiscard]] const EmissiveTriangle& triangle(std::uint32_t index) const { return triangles_[index]; }
  [[nodiscard]] std::size_t triangle_count() const { return triangles_.size(); }
  [[nodiscard]] std::size_t punctual_count() const { return punctual_.size(); }
  [[nodiscard]] bool empty() const;

 private:
  std::vector<EmissiveTriangle> triangles_;
  std::vector<PunctualLight> punctual_;
  const EnvironmentMap* environment_;
  Rgb total_flux_{0, 0, 0};
  // The owner of this file completes it.
};

}  // namespace pf
