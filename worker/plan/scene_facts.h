#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/math/vec.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// Materials in use (placed at least once), by what they do to light. The first six exclude each other, the
/// others are counted beside them. A texture counts as the factor that it multiplies, its upper bound.
struct MaterialCounts {
  int diffuse = 0;  ///< Lambert, perhaps under a coat rougher than kGlossyRoughness
  int glossy = 0;   ///< dielectric coat smooth enough to show reflections
  int metal = 0;
  int glass = 0;       ///< bounds a medium: refracts
  int thin_glass = 0;  ///< transmits without refraction
  int unlit = 0;       ///< KHR_materials_unlit: emits, scatters nothing
  int clearcoat = 0;
  int sheen = 0;
  int emissive = 0;
  int alpha_mask = 0;
  int alpha_blend = 0;
};

/// Lights by kind. Flux [W] is the sum over the three channels' average; textures count as white.
struct LightCounts {
  int points = 0;
  int spots = 0;
  int directional = 0;
  std::int64_t emissive_triangles = 0;  ///< placed
  double point_flux = 0;
  double spot_flux = 0;
  double directional_flux = 0;  ///< through the disc around the scene's bounding sphere
  double emissive_flux = 0;
  bool environment = false;
  bool environment_map = false;  ///< its flux is known only after reading it
  double environment_flux = 0;   ///< of a constant environment, through the same disc

  [[nodiscard]] bool any() const { return points + spots + directional > 0 || emissive_triangles > 0 || environment; }
};

/// A mirror-like or transmitting surface: what can focus light. How it meets the lights decides whether a
/// path tracer can find its caustics.
struct CausticFacts {
  int casters = 0;                 ///< placed meshes whose material focuses light
  int reached_by_small = 0;        ///< of these, lit by a point, spot or directional light or by a small emitter
  int reached_by_large = 0;        ///< of the rest, lit by a large emitter or the environment
  double smallest_light = 1.0;     ///< smallest share of the sphere that a light fills, seen from a caster; 0: a point
  std::vector<std::string> names;  ///< materials of the casters reached, each once, in document order, at most four
  int lights_in_glass = 0;         ///< lights that stand inside the bounding box of a transmitting mesh
};

/// What a scene holds, as far as the choice of an algorithm and of its terms asks for it.
struct SceneFacts {
  std::int64_t triangles = 0;         ///< stored
  std::int64_t triangles_placed = 0;  ///< as seen in the world
  int meshes = 0;                     ///< that are placed at least once
  int instances = 0;
  int instanced_meshes = 0;  ///< placed more than once
  MaterialCounts materials;
  LightCounts lights;
  CausticFacts caustics;
  int textures = 0;                  ///< used by a material in use
  int normal_maps = 0;               ///< materials in use that have one
  int rough_lobes = 0;               ///< materials in use with a lobe that is neither Lambert nor a perfect mirror
  int media = 0;                     ///< materials in use that absorb inside
  std::vector<std::string> cameras;  ///< names in document order
  Box3f bounds;                      ///< world space, metres; empty for a scene without triangles
};

/// Above this perceptual roughness a dielectric's reflection is too blurred to be told from diffuse light.
inline constexpr float kGlossyRoughness = 0.5f;
/// Up to this perceptual roughness (GGX alpha 0.16: a lobe of about 10 degrees) a surface focuses light
/// visibly.
inline constexpr float kCasterRoughness = 0.4f;
/// Least share of light, at normal incidence, that must leave by the focusing lobe: above a plastic's 4 %.
inline constexpr float kCasterShare = 0.1f;
/// A light that fills less of the sphere around a caster is hit too rarely by paths that come from the eye.
inline constexpr double kSmallLight = 0.02;

/// Counts and measures a scene in one pass over its placed triangles (a fixed subset of very large meshes
/// stands for the whole in areas). Same description, same facts.
[[nodiscard]] SceneFacts gather_facts(const SceneDescription& scene);

}  // namespace pf
