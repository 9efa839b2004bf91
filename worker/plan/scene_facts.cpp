#include "worker/plan/scene_facts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

namespace pf {
namespace {

/// Emitters with more triangles are taken to shine everywhere instead of being tested face by face.
constexpr std::size_t kMaxFacesTested = 64;
constexpr std::size_t kMaxNames = 4;
/// A transmitting mesh larger than this share of the scene is a window or water, not the glass of a lamp.
constexpr double kLargestLampGlass = 0.5;
constexpr double kSphere = 4.0 * 3.14159265358979323846;

bool differs_from_white(const Rgb& c) { return c.x != 1.0f || c.y != 1.0f || c.z != 1.0f; }

bool is_smooth(float roughness, const TextureRef& texture) { return roughness == 0.0f && !texture.present(); }

/// Normal reflectance of the dielectric interface (KHR_materials_ior; ior 0 stands for infinity).
float dielectric_f0(const Material& m) {
  const float root = m.ior == 0.0f ? 1.0f : (m.ior - 1.0f) / (m.ior + 1.0f);
  return std::min(1.0f, root * root * max_component(m.specular_color)) * m.specular;
}

float transmitted_share(const Material& m) { return m.transmission * (1.0f - m.metallic); }

bool transmits(const Material& m) {
  return !m.unlit && (transmitted_share(m) > 0.0f || (m.transmission > 0.0f && m.metallic_roughness_texture.present()));
}

/// Does the material send a visible share of light into a narrow lobe? A texture may make a surface smoother
/// than its factor says, so half the factor is assumed.
bool focuses_light(const Material& m) {
  if (m.unlit) return false;
  const float roughness = m.metallic_roughness_texture.present() ? 0.5f * m.roughness : m.roughness;
  if (roughness > kCasterRoughness) return false;
  const float mirror = std::max(m.metallic * max_component(m.base_color), (1.0f - m.metallic) * dielectric_f0(m));
  return std::max(mirror, transmits(m) ? m.transmission : 0.0f) >= kCasterShare;
}

bool emits(const Material& m) { return !is_zero(m.emission) || (m.unlit && !is_zero(m.base_color)); }

Rgb radiance_of(const Material& m) { return m.unlit ? m.emission + m.base_color : m.emission; }

void count_kind(const Material& m, MaterialCounts& counts) {
  if (m.unlit) {
    ++counts.unlit;
  } else if (transmits(m)) {
    ++(m.thickness > 0.0f ? counts.glass : counts.thin_glass);
  } else if (m.metallic >= 0.5f) {
    ++counts.metal;
  } else {
    const bool shows = dielectric_f0(m) > 0.0f && m.roughness < kGlossyRoughness;
    ++(shows ? counts.glossy : counts.diffuse);
  }
  if (m.unlit) return;
  counts.clearcoat += m.clearcoat > 0.0f;
  counts.sheen += !is_zero(m.sheen_color);
}

bool has_rough_lobe(const Material& m) {
  if (m.unlit) return false;
  const bool specular = dielectric_f0(m) > 0.0f || m.metallic > 0.0f || transmits(m);
  if (specular && !is_smooth(m.roughness, m.metallic_roughness_texture)) return true;
  if (m.clearcoat > 0.0f && !is_smooth(m.clearcoat_roughness, m.clearcoat_roughness_texture)) return true;
  return !is_zero(m.sheen_color);
}

std::array<const TextureRef*, 12> texture_slots(const Material& m) {
  return {&m.base_color_texture,       &m.metallic_roughness_texture, &m.normal_texture,
          &m.emission_texture,         &m.specular_texture,           &m.specular_color_texture,
          &m.transmission_texture,     &m.clearcoat_texture,          &m.clearcoat_roughness_texture,
          &m.clearcoat_normal_texture, &m.sheen_color_texture,        &m.sheen_roughness_texture};
}

void count_materials(const SceneDescription& scene, const std::vector<bool>& used, SceneFacts& facts) {
  std::set<int> textures;
  for (std::size_t i = 0; i < scene.materials.size(); ++i) {
    if (!used[i]) continue;
    const Material& m = scene.materials[i];
    count_kind(m, facts.materials);
    facts.materials.emissive += emits(m);
    facts.materials.alpha_mask += m.alpha_mode == AlphaMode::kMask;
    facts.materials.alpha_blend += m.alpha_mode == AlphaMode::kBlend;
    facts.normal_maps += m.normal_texture.present() || m.clearcoat_normal_texture.present();
    facts.rough_lobes += has_rough_lobe(m);
    facts.media += transmits(m) && m.thickness > 0.0f && std::isfinite(m.attenuation_distance) &&
                   differs_from_white(m.attenuation_color);
    for (const TextureRef* slot : texture_slots(m)) {
      if (slot->present()) textures.insert(slot->texture);
    }
  }
  facts.textures = static_cast<int>(textures.size());
}

struct Face {
  Vec3f point;
  Vec3f normal;  // not unit
};

/// A placed mesh that emits or focuses light.
struct Placed {
  const Material* material = nullptr;
  Box3f bounds;
  double area = 0;
  std::vector<Face> faces;  // of an emitter with few triangles
};

struct Surfaces {
  std::vector<Placed> emitters;
  std::vector<Placed> casters;
  std::vector<Placed> glass;
};

Placed place(const Mesh& mesh, const MeshInstance& instance, const Material& material) {
  Placed placed;
  placed.material = &material;
  const std::size_t count = mesh.triangles.size();
  // Areas only weigh: of a mesh beyond a million triangles every n-th is enough.
  const std::size_t stride = 1 + count / 1'000'000;
  std::size_t measured = 0;
  for (std::size_t t = 0; t < count; t += stride, ++measured) {
    std::array<Vec3f, 3> p;
    for (std::size_t k = 0; k < 3; ++k) p[k] = mesh.positions[mesh.triangles[t][k]] * instance.object_to_world;
    const Vec3f normal = cross(p[1] - p[0], p[2] - p[0]);
    placed.area += 0.5 * static_cast<double>(length(normal));
    for (const Vec3f& corner : p) placed.bounds.extendBy(corner);
    if (count <= kMaxFacesTested) placed.faces.push_back({p[0], normal});
  }
  if (measured > 0) placed.area *= static_cast<double>(count) / static_cast<double>(measured);
  // glTF keeps the front face outside for mirrored instances: the winding of a negative determinant is the
  // other one.
  if (instance.object_to_world.determinant() < 0.0f) {
    for (Face& face : placed.faces) face.normal = -face.normal;
  }
  return placed;
}

/// Bounds of a box's eight corners in the world: cheap for meshes that are placed many times.
Box3f transformed(const Box3f& box, const Matrix44f& m) {
  Box3f result;
  if (box.isEmpty()) return result;
  for (unsigned corner = 0; corner < 8; ++corner) {
    const Vec3f p(corner & 1u ? box.max.x : box.min.x, corner & 2u ? box.max.y : box.min.y,
                  corner & 4u ? box.max.z : box.min.z);
    result.extendBy(p * m);
  }
  return result;
}

Surfaces count_geometry(const SceneDescription& scene, SceneFacts& facts) {
  Surfaces surfaces;
  std::vector<int> placements(scene.meshes.size(), 0);
  std::vector<bool> used(scene.materials.size(), false);
  std::vector<Box3f> boxes(scene.meshes.size());
  for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
    for (const Vec3f& p : scene.meshes[i].positions) boxes[i].extendBy(p);
  }
  for (const MeshInstance& instance : scene.instances) {
    const auto index = static_cast<std::size_t>(instance.mesh);
    const Mesh& mesh = scene.meshes[index];
    const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
    used[static_cast<std::size_t>(mesh.material)] = true;
    const auto count = static_cast<std::int64_t>(mesh.triangles.size());
    if (placements[index]++ == 0) {
      ++facts.meshes;
      facts.triangles += count;
    }
    ++facts.instances;
    facts.triangles_placed += count;
    facts.bounds.extendBy(transformed(boxes[index], instance.object_to_world));
    if (count == 0) continue;
    if (emits(material)) {
      surfaces.emitters.push_back(place(mesh, instance, material));
      facts.lights.emissive_triangles += count;
    }
    if (focuses_light(material)) surfaces.casters.push_back(place(mesh, instance, material));
    if (transmits(material)) {
      surfaces.glass.push_back({&material, transformed(boxes[index], instance.object_to_world), 0, {}});
    }
  }
  facts.instanced_meshes =
      static_cast<int>(std::count_if(placements.begin(), placements.end(), [](int n) { return n > 1; }));
  count_materials(scene, used, facts);
  return surfaces;
}

double radius_of(const Box3f& box) { return box.isEmpty() ? 0.0 : 0.5 * static_cast<double>(length(box.size())); }

void count_lights(const SceneDescription& scene, const Surfaces& surfaces, SceneFacts& facts) {
  LightCounts& lights = facts.lights;
  const double radius = radius_of(facts.bounds);
  const double disc = 0.25 * kSphere * radius * radius;
  for (const PunctualLight& light : scene.lights) {
    const double intensity = average(light.intensity);
    switch (light.kind) {
      case PunctualKind::kPoint:
        ++lights.points;
        lights.point_flux += kSphere * intensity;
        break;
      case PunctualKind::kSpot: {
        // KHR_lights_punctual: the fall-off is a square in the cosine, whose mean over the rim is 1/3.
        const double cap = (1.0 - light.cos_inner) + (light.cos_inner - light.cos_outer) / 3.0;
        ++lights.spots;
        lights.spot_flux += 0.5 * kSphere * cap * intensity;
        break;
      }
      case PunctualKind::kDirectional:
        ++lights.directional;
        lights.directional_flux += disc * intensity;
        break;
    }
  }
  for (const Placed& emitter : surfaces.emitters) {
    const double faces = emitter.material->double_sided ? 2.0 : 1.0;
    lights.emissive_flux += 0.25 * kSphere * average(radiance_of(*emitter.material)) * emitter.area * faces;
  }
  lights.environment = scene.environment.present();
  lights.environment_map = !scene.environment.file.empty();
  if (lights.environment && !lights.environment_map) {
    lights.environment_flux = kSphere * average(scene.environment.radiance) * disc;
  }
}

bool lies_in_front(const Face& face, const Box3f& box) {
  // The corner of the box that lies furthest along the normal.
  const Vec3f corner(face.normal.x > 0 ? box.max.x : box.min.x, face.normal.y > 0 ? box.max.y : box.min.y,
                     face.normal.z > 0 ? box.max.z : box.min.z);
  return dot(face.normal, corner - face.point) > 0.0f;
}

bool shines_on(const Placed& emitter, const Placed& caster) {
  if (emitter.material->double_sided || emitter.faces.empty()) return true;
  return std::any_of(emitter.faces.begin(), emitter.faces.end(),
                     [&](const Face& face) { return lies_in_front(face, caster.bounds); });
}

/// Is any part of the bounding sphere inside the spot's cone? [cone widened by the sphere's angular radius]
bool shines_on(const PunctualLight& light, const Placed& caster) {
  if (is_zero(light.intensity)) return false;
  if (light.kind != PunctualKind::kSpot) return true;
  const Vec3f to = caster.bounds.center() - light.position;
  const double distance = length(to);
  const double radius = radius_of(caster.bounds);
  if (distance <= radius) return true;
  const double angle = std::acos(std::clamp(static_cast<double>(dot(to, light.direction)) / distance, -1.0, 1.0));
  return angle <= std::acos(std::clamp(static_cast<double>(light.cos_outer), -1.0, 1.0)) + std::asin(radius / distance);
}

/// Share of the sphere around the caster that the emitter fills at most: its area, seen from the front, at
/// the distance between the boxes' centres (1 when it surrounds the caster).
double share_of_sphere(const Placed& emitter, const Placed& caster) {
  const double distance = length(emitter.bounds.center() - caster.bounds.center());
  if (distance == 0.0) return 1.0;
  return std::min(1.0, emitter.area / (kSphere * distance * distance));
}

/// The smallest light that reaches the caster: 0 for a point, 1 for the environment, above 1 for none.
double smallest_light(const SceneDescription& scene, const Surfaces& surfaces, const Placed& caster) {
  for (const PunctualLight& light : scene.lights) {
    if (shines_on(light, caster)) return 0.0;
  }
  double smallest = scene.environment.present() ? 1.0 : 2.0;
  for (const Placed& emitter : surfaces.emitters) {
    if (smallest < kSmallLight) break;  // decided; scenes with thousands of lamps need no exact minimum
    if (shines_on(emitter, caster)) smallest = std::min(smallest, share_of_sphere(emitter, caster));
  }
  return smallest;
}

void find_caustics(const SceneDescription& scene, const Surfaces& surfaces, SceneFacts& facts) {
  CausticFacts& caustics = facts.caustics;
  caustics.casters = static_cast<int>(surfaces.casters.size());
  for (const Placed& caster : surfaces.casters) {
    const double smallest = smallest_light(scene, surfaces, caster);
    if (smallest > 1.0) continue;
    ++(smallest < kSmallLight ? caustics.reached_by_small : caustics.reached_by_large);
    caustics.smallest_light = std::min(caustics.smallest_light, smallest);
    const std::string& name = caster.material->name;
    const bool known = std::find(caustics.names.begin(), caustics.names.end(), name) != caustics.names.end();
    if (!name.empty() && !known && caustics.names.size() < kMaxNames) caustics.names.push_back(name);
  }
  const double largest = kLargestLampGlass * radius_of(facts.bounds);
  const auto stands_in_glass = [&](const Vec3f& centre) {
    return std::any_of(surfaces.glass.begin(), surfaces.glass.end(), [&](const Placed& glass) {
      return glass.bounds.intersects(centre) && radius_of(glass.bounds) <= largest;
    });
  };
  for (const PunctualLight& light : scene.lights) {
    caustics.lights_in_glass += light.kind != PunctualKind::kDirectional && stands_in_glass(light.position);
  }
  for (const Placed& emitter : surfaces.emitters) {
    caustics.lights_in_glass += stands_in_glass(emitter.bounds.center());
  }
}

}  // namespace

SceneFacts gather_facts(const SceneDescription& scene) {
  SceneFacts facts;
  const Surfaces surfaces = count_geometry(scene, facts);
  count_lights(scene, surfaces, facts);
  find_caustics(scene, surfaces, facts);
  for (const Camera& camera : scene.cameras) facts.cameras.push_back(camera.name);
  return facts;
}

}  // namespace pf
