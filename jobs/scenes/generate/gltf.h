#pragma once

#include <cstddef>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "jobs/scenes/generate/mesh.h"

namespace pf::scenes {

/// Materials as glTF JSON. All numbers are linear.
using Material = nlohmann::ordered_json;

/// Lambert reflector: KHR_materials_specular with factor 0 leaves nothing but the diffuse lobe.
[[nodiscard]] Material lambert(const std::string& name, const Vec3& albedo);
/// A Lambert reflector that also emits `radiance` [W sr^-1 m^-2] from its front.
[[nodiscard]] Material emitter(const std::string& name, const Vec3& radiance, const Vec3& albedo = Vec3(0.0));
/// Metal with reflectance `color` at normal incidence; `roughness` is glTF's (GGX alpha is its square).
[[nodiscard]] Material metal(const std::string& name, const Vec3& color, double roughness);
/// Smooth refracting medium inside a closed mesh, `thickness` metres across (only its being above 0 matters
/// here).
[[nodiscard]] Material dielectric(const std::string& name, double ior, double thickness);
/// The same, coloured: white light has the colour `color` after `distance` metres.
[[nodiscard]] Material dielectric(const std::string& name, double ior, double thickness, const Vec3& color,
                                  double distance);

/// Collects meshes, one camera and lights, and packs them as one binary glTF 2.0 file.
class GltfBuilder {
 public:
  void add(const std::string& name, const Mesh& mesh, const Material& material);
  /// Places a shared unit icosphere by scale and translation, so that many fine spheres cost the bytes of
  /// one.
  void add_sphere(const std::string& name, const Vec3& centre, double radius, int subdivisions,
                  const Material& material);
  /// Perspective camera "camera"; `yfov` in radians.
  void set_camera(const Vec3& eye, const Vec3& target, double yfov, double aspect_ratio);
  /// KHR_lights_punctual directional light that shines along `direction`; `irradiance` in W/m^2 at normal
  /// incidence.
  void add_directional_light(const std::string& name, const Vec3& direction, const Vec3& irradiance);
  /// The bytes of the .glb file.
  [[nodiscard]] std::string pack() const;

 private:
  using Json = nlohmann::ordered_json;
  int add_material(const Material& material);
  int add_floats(const std::vector<Vec3>& values, bool with_bounds);
  int add_indices(const Mesh& mesh);
  Json add_attributes(const Mesh& mesh, bool normals_are_positions);
  void add_node(Json node);
  int add_view(std::size_t offset, int target);

  std::string binary_;
  Json views_ = Json::array(), accessors_ = Json::array(), materials_ = Json::array(), meshes_ = Json::array();
  Json nodes_ = Json::array(), cameras_ = Json::array(), lights_ = Json::array();
  std::set<std::string> extensions_;
  std::map<int, Json> spheres_;  // by subdivisions: a primitive without its material
};

}  // namespace pf::scenes
