#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/math/distribution.h"
#include "common/math/lane_sampling.h"
#include "common/math/vec.h"
#include "worker/scene/area_light.h"
#include "worker/scene/emissive_triangle.h"
#include "worker/scene/environment.h"
#include "worker/scene/light_tree.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// A sample of light arriving at a point (next-event estimation).
struct LightSample {
  Vec3f wi{0, 0, 1};      ///< unit, towards the light
  float distance = 0;     ///< metres to the sampled point; kInfinity for directional lights and environment
  Rgb radiance{0, 0, 0};  ///< Le; of a delta light I/d^2 or E, and pdf_w then counts only the choice
  float pdf_w = 0;        ///< per steradian, probability of choosing this light included
  bool delta = false;     ///< point, spot, directional: no other technique can find it
};

/// The start of a photon path.
struct Emission {
  Vec3f origin{0, 0, 0};     ///< on the light (already offset off the surface), or on a disc outside the scene
  Vec3f direction{0, 0, 1};  ///< unit
  Rgb flux{0, 0, 0};         ///< W carried by the path if it were the only one: emitted radiance * cos / pdf
  /// For figures per light: the triangle's index; then come the punctual lights, and last the environment.
  std::uint32_t light = 0;
};

/// Eight starts of photon paths, side by side; see Lights::EmissionPicked.
struct EmissionLanes {
  unsigned lanes = 0;  ///< bit i: lane i carries something
  Vec3x8 origin, direction, flux;
  std::array<std::int32_t, kLanes> triangle;
  std::array<Vec2f, kLanes> barycentric;

  void set(std::size_t lane, const Emission& emission) {
    lanes |= 1u << lane;
    origin.set(lane, emission.origin);
    direction.set(lane, emission.direction);
    flux.set(lane, emission.flux);
  }
};

/// Every light of a scene: emissive triangles, punctual lights, environment.
/// Choice for next-event estimation is by estimated contribution at the point: a light tree with orientation
/// cones [Conty Estevez and Kulla 2018; pbrt-v4 12.6.3]. Choice for emission is by flux.
class Lights {
 public:
  /// `triangles`: all emissive triangles. `bounds`: of the scene (disc for directional lights and
  /// environment). `environment` may be null, and must outlive this.
  Lights(std::vector<EmissiveTriangle> triangles, std::vector<PunctualLight> punctual,
         const EnvironmentMap* environment, const Box3f& bounds);

  /// Samples light arriving at `p` on a surface with normal `n` (both hemispheres count when `transmissive`).
  /// Occlusion is the caller's. Empty when this sample contributes nothing. For a triangle, radiance is that
  /// of the triangle (its textured value: the caller multiplies, see triangle()). Numbers in [0, 1).
  struct Picked {
    LightSample sample;
    std::int32_t triangle = -1;
    Vec2f barycentric{0.0f, 0.0f};
  };
  [[nodiscard]] std::optional<Picked> sample(const Vec3f& p, const Vec3f& n, bool transmissive, float u_pick,
                                             const Vec2f& u) const;
  /// Density per steradian with which sample() from (p, n) returns the point `q` of emissive triangle
  /// `index`.
  [[nodiscard]] float pdf_w(const Vec3f& p, const Vec3f& n, bool transmissive, std::uint32_t index,
                            const Vec3f& q) const;
  /// Same for the environment in direction `wi`.
  [[nodiscard]] float pdf_w_environment(const Vec3f& p, const Vec3f& n, bool transmissive, const Vec3f& wi) const;

  /// Starts a photon path: u_pick chooses the light by flux, `u_position` and `u_direction` the ray. Empty
  /// only when no light emits anything.
  struct EmissionPicked {
    Emission emission;
    std::int32_t triangle = -1;
    Vec2f barycentric{0.0f, 0.0f};
  };
  [[nodiscard]] std::optional<EmissionPicked> emit(float u_pick, const Vec2f& u_position,
                                                   const Vec2f& u_direction) const;
  /// emit() for eight paths at once, to the same bits. Without `find_points` nothing is said of triangles.
  void emit(const Float8& u_pick, const Vec2x8& u_position, const Vec2x8& u_direction, bool find_points,
            EmissionLanes& emissions) const;

  /// Sum over all lights of the emitted flux [W] (into the scene's bounds for directional lights and
  /// environment).
  [[nodiscard]] const Rgb& total_flux() const { return total_flux_; }
  [[nodiscard]] const EmissiveTriangle& triangle(std::uint32_t index) const { return triangles_[index]; }
  [[nodiscard]] std::size_t triangle_count() const { return triangles_.size(); }
  [[nodiscard]] std::size_t punctual_count() const { return punctual_.size(); }
  [[nodiscard]] bool empty() const;
  /// Emitters that next-event estimation chooses among: triangles, or pairs of them that make a
  /// parallelogram.
  [[nodiscard]] const std::vector<AreaLight>& area_lights() const { return area_lights_; }

 private:
  struct Choice;

  void build_tree();
  void build_emission();
  [[nodiscard]] Choice choice(const Receiver& receiver) const;
  [[nodiscard]] float exact(const Receiver& receiver, std::uint32_t leaf) const;
  [[nodiscard]] float tree_importance(const Receiver& receiver) const;
  [[nodiscard]] float directional_importance(const Receiver& receiver, std::uint32_t light) const;
  [[nodiscard]] float environment_importance() const;
  [[nodiscard]] std::optional<Picked> sample_tree(const Receiver& receiver, float u_pick, const Vec2f& u) const;
  [[nodiscard]] std::optional<Picked> sample_area(const Receiver& receiver, std::uint32_t leaf, const Vec2f& u) const;
  [[nodiscard]] std::optional<Picked> sample_punctual(const Receiver& receiver, std::uint32_t light) const;
  [[nodiscard]] std::optional<Picked> sample_environment(const Receiver& receiver, const Vec2f& u) const;
  [[nodiscard]] EmissionPicked emit_area(std::uint32_t light, float u_side, const Vec2f& u_position,
                                         const Vec2f& u_direction) const;
  void emit_areas(unsigned lanes, const std::array<std::uint32_t, kLanes>& lights, const Float8& u_side,
                  const Vec2x8& u_position, const Vec2x8& u_direction, bool find_points,
                  EmissionLanes& emissions) const;
  [[nodiscard]] std::optional<Distribution1D::Pick> pick_emitter(float u) const;
  [[nodiscard]] EmissionPicked emit_by(const Distribution1D::Pick& pick, const Vec2f& u_position,
                                       const Vec2f& u_direction) const;
  [[nodiscard]] EmissionPicked emit_distant(const Vec3f& direction, const Rgb& flux, const Vec2f& u_position) const;

  std::vector<EmissiveTriangle> triangles_;
  std::vector<PunctualLight> punctual_;
  const EnvironmentMap* environment_;
  Rgb total_flux_{0, 0, 0};
  std::vector<AreaLight> area_lights_;
  std::vector<std::int32_t> area_light_of_triangle_;  ///< -1: emits nothing
  std::vector<std::uint32_t> near_punctual_;          ///< point and spot lights: leaves after the area lights
  std::vector<std::uint32_t> directional_;
  LightTree tree_;
  Distribution1D emission_;       ///< area lights, punctual lights, environment; by flux
  std::vector<Rgb> picked_flux_;  ///< of each of them: its flux over the probability of choosing it [W]
  Vec3f center_{0, 0, 0};         ///< sphere around the scene
  float radius_ = 0;
};

}  // namespace pf
