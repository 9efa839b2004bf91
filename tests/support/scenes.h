#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/spec/job_spec.h"
#include "worker/scene/scene.h"
#include "worker/scene/scene_description.h"

namespace pf::test {

/// Builds small scenes by hand, with answers known without our code.
class SceneMaker {
 public:
  SceneMaker();

  /// Adds a material and returns its index.
  int lambert(const Rgb& albedo);
  int emitter(const Rgb& radiance, const Rgb& albedo = {0, 0, 0});
  int mirror(const Rgb& reflectance = {1, 1, 1});
  int metal(const Rgb& f0, float roughness);
  int glass(float ior, const Rgb& tint = {1, 1, 1}, float roughness = 0);
  int plastic(const Rgb& albedo, float roughness);
  int material(const Material& m);

  /// A parallelogram from `corner` along `a` and `b`; front side towards a x b.
  void quad(const Vec3f& corner, const Vec3f& a, const Vec3f& b, int material);
  /// Axis-aligned box; `inward` turns the front sides in.
  void box(const Vec3f& low, const Vec3f& high, int material, bool inward = false);
  /// Sphere of rings x 2 rings quads, vertices on the sphere, analytic normals; `inward` turns the front side in.
  void sphere(const Vec3f& centre, float radius, int material, int rings = 64, bool inward = false);
  /// Disc of `segments` triangles, corners on the circle; front side towards `normal`. Returns the corners in order.
  std::vector<Vec3f> disc(const Vec3f& centre, const Vec3f& normal, float radius, int material, int segments = 64);

  /// Looks from `eye` to `target`; yfov in radians.
  void camera(const Vec3f& eye, const Vec3f& target, float yfov);
  /// Same without perspective: sees a rectangle of these half-extents (looking down, +x is right and -z up).
  void orthographic_camera(const Vec3f& eye, const Vec3f& target, float half_width, float half_height);

  void point_light(const Vec3f& position, float intensity);
  void directional_light(const Vec3f& direction, float irradiance);
  /// Full intensity within `cos_inner`, none beyond `cos_outer`.
  void spot_light(const Vec3f& position, const Vec3f& direction, float intensity, float cos_inner, float cos_outer);
  void environment(const Rgb& radiance) { description.environment.radiance = radiance; }

  SceneDescription description;
  [[nodiscard]] std::unique_ptr<const Scene> build() const;

 private:
  int add(const Mesh& mesh);
};

/// The Cornell box of the peers' measurements: mirror and glass sphere under a quad light (tests/bench/README.md).
[[nodiscard]] SceneMaker peer_box(int rings = 128);
/// The same room with nothing but diffuse walls and a diffuse block.
[[nodiscard]] SceneMaker diffuse_box();
/// A grey floor of 4 m without a lamp, under a camera that sees nearly all of it.
[[nodiscard]] SceneMaker bare_floor();

/// A furnace seen into a corner: walls of radiance 1 and albedo 1/2, which look 2 everywhere.
[[nodiscard]] SceneMaker furnace_box();
/// A room of grey walls and a point light, seen straight into a corner: the edge between two walls is the picture's
/// middle column.
[[nodiscard]] SceneMaker corner_room();

/// A job of the given size with defaults otherwise.
[[nodiscard]] JobSpec job(int width, int height, IntegratorType type, std::int64_t photons = 20000);

}  // namespace pf::test
