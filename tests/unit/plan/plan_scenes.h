#pragma once

#include <string>

#include "worker/scene/scene_description.h"

namespace pf::plan_test {

/// A square of side 2 around the origin, in the plane y=0, front side up.
inline Mesh quad(int material) {
  Mesh mesh;
  mesh.positions = {{-1, 0, -1}, {-1, 0, 1}, {1, 0, 1}, {1, 0, -1}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  mesh.material = material;
  return mesh;
}

inline Material diffuse(std::string name = "white") {
  Material m;
  m.name = std::move(name);
  m.metallic = 0;
  m.specular = 0;
  return m;
}

inline Material mirror() {
  Material m;
  m.name = "mirror";
  m.roughness = 0;
  return m;
}

inline Material glass() {
  Material m = diffuse("glass");
  m.specular = 1;
  m.roughness = 0;
  m.transmission = 1;
  m.thickness = 0.1f;
  return m;
}

inline Material lamp(float radiance) {
  Material m = diffuse("lamp");
  m.emission = Rgb(radiance, radiance, radiance);
  return m;
}

inline Matrix44f placed(const Vec3f& scale, const Vec3f& translation) {
  Matrix44f s, t;
  s.setScale(scale);
  t.setTranslation(translation);
  return s * t;
}

/// Upside down: a quad's front side then looks along -y.
inline Matrix44f facing_down(const Vec3f& scale, const Vec3f& translation) {
  Matrix44f flip;
  flip.setScale(Vec3f(1, -1, -1));
  return flip * placed(scale, translation);
}

/// A large diffuse floor and one camera; nothing emits.
inline SceneDescription floor_scene() {
  SceneDescription scene;
  scene.materials.push_back(diffuse());
  scene.meshes.push_back(quad(0));
  scene.instances.push_back({0, placed(Vec3f(10, 1, 10), Vec3f(0, 0, 0))});
  scene.cameras.push_back(Camera{});
  scene.cameras.back().name = "front";
  return scene;
}

/// Adds one placed quad with a material of its own.
inline void add_quad(SceneDescription& scene, const Material& material, const Matrix44f& object_to_world) {
  scene.materials.push_back(material);
  scene.meshes.push_back(quad(static_cast<int>(scene.materials.size()) - 1));
  scene.instances.push_back({static_cast<int>(scene.meshes.size()) - 1, object_to_world});
}

inline PunctualLight point_light(const Vec3f& position, float intensity = 1) {
  PunctualLight light;
  light.position = position;
  light.intensity = Rgb(intensity, intensity, intensity);
  return light;
}

}  // namespace pf::plan_test
