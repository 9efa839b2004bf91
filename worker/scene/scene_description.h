#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/math/vec.h"

namespace pf {

/// Plain data between the glTF loader and the renderer: what a scene holds, checked (every index in range, every number
/// finite), in the rest pose, in metres and right-handed y-up world space. Tests build small ones by hand; Scene::build
/// turns one into something that can be traced.

/// Reference to a texture from one material slot; `texture < 0` means none.
struct TextureRef {
  int texture = -1;
  int uv_set = 0;            ///< index into Mesh::uv
  Vec2f offset{0.0f, 0.0f};  ///< KHR_texture_transform: uv' = T(offset) R(rotation) S(scale) uv
  Vec2f scale{1.0f, 1.0f};
  float rotation = 0.0f;  ///< radians, counter-clockwise
  [[nodiscard]] bool present() const { return texture >= 0; }
};

enum class Wrap { kRepeat, kMirror, kClamp };
enum class ColorSpace {
  kSrgb,
  kLinear
};  ///< glTF: base colour, emissive, sheen and specular colour are sRGB; all else linear

/// One glTF texture: an image and a sampler.
struct Texture {
  std::string name;  ///< for messages
  std::string file;  ///< absolute path, or empty when `bytes` holds the encoded image
  std::shared_ptr<const std::vector<std::uint8_t>> bytes;  ///< encoded PNG/JPEG/...; shared by textures of one image
  Wrap wrap_s = Wrap::kRepeat;
  Wrap wrap_t = Wrap::kRepeat;
  bool nearest = false;  ///< magFilter NEAREST
  ColorSpace color_space = ColorSpace::kLinear;
};

enum class AlphaMode { kOpaque, kMask, kBlend };

/// glTF 2.0 metallic-roughness material with the supported KHR_materials_* extensions; factors multiply textures.
struct Material {
  std::string name;
  // pbrMetallicRoughness
  Rgb base_color{1.0f, 1.0f, 1.0f};
  TextureRef base_color_texture;
  float alpha = 1.0f;      ///< baseColorFactor.a, times the texture's A and vertex colour's A
  float metallic = 1.0f;   ///< times B of metallic_roughness_texture
  float roughness = 1.0f;  ///< perceptual; GGX alpha = roughness^2; times G
  TextureRef metallic_roughness_texture;
  // core
  TextureRef normal_texture;
  float normal_scale = 1.0f;
  Rgb emission{0.0f, 0.0f, 0.0f};  ///< radiance: emissiveFactor * emissiveStrength
  TextureRef emission_texture;
  AlphaMode alpha_mode = AlphaMode::kOpaque;
  float alpha_cutoff = 0.5f;
  bool double_sided = false;  ///< emission leaves both faces; scattering is two-sided for every material
  bool unlit = false;         ///< KHR_materials_unlit: emits base colour, scatters nothing
  // KHR_materials_ior, _specular
  float ior = 1.5f;  ///< >= 1; 0 stands for infinite (glTF: specular-glossiness compatibility)
  float specular = 1.0f;
  TextureRef specular_texture;  ///< A channel; 0 leaves a pure Lambert surface
  Rgb specular_color{1.0f, 1.0f, 1.0f};
  TextureRef specular_color_texture;
  // KHR_materials_transmission, _volume
  float transmission = 0.0f;
  TextureRef transmission_texture;         ///< R channel
  float thickness = 0.0f;                  ///< 0: thin-walled; else the mesh bounds a medium that refracts and absorbs
  float attenuation_distance = kInfinity;  ///< metres at which white becomes attenuation_color
  Rgb attenuation_color{1.0f, 1.0f, 1.0f};
  // KHR_materials_clearcoat
  float clearcoat = 0.0f;
  TextureRef clearcoat_texture;  ///< R channel
  float clearcoat_roughness = 0.0f;
  TextureRef clearcoat_roughness_texture;  ///< G channel
  TextureRef clearcoat_normal_texture;
  float clearcoat_normal_scale = 1.0f;
  // KHR_materials_sheen
  Rgb sheen_color{0.0f, 0.0f, 0.0f};
  TextureRef sheen_color_texture;
  float sheen_roughness = 0.0f;
  TextureRef sheen_roughness_texture;  ///< A channel
};

inline constexpr int kMaxUvSets = 4;

/// Triangles of one glTF primitive, in object space, rest pose (morph weights and skin applied).
struct Mesh {
  std::string name;
  std::vector<Vec3f> positions;
  std::vector<Vec3f> normals;   ///< unit, per vertex; empty: flat shading
  std::vector<Vec4f> tangents;  ///< unit xyz, w = bitangent sign; empty unless a normal map needs them
  std::array<std::vector<Vec2f>, kMaxUvSets> uv;  ///< each empty or one per vertex
  std::vector<Vec4f> colors;                      ///< linear RGBA that multiplies base colour; empty: white
  std::vector<std::array<std::uint32_t, 3>> triangles;
  int material = 0;  ///< index into SceneDescription::materials
};

/// A mesh placed in the world. Meshes placed more than once become Embree instances.
struct MeshInstance {
  int mesh = 0;
  Matrix44f object_to_world;  ///< row-vector convention; may mirror (negative determinant), never singular
};

enum class PunctualKind { kPoint, kSpot, kDirectional };

/// KHR_lights_punctual. Photometric units are taken as radiometric ones, channel by channel.
struct PunctualLight {
  PunctualKind kind = PunctualKind::kPoint;
  Rgb intensity{1.0f, 1.0f, 1.0f};  ///< point and spot: W/sr; directional: W/m^2 (irradiance at normal incidence)
  Vec3f position{0.0f, 0.0f, 0.0f};
  Vec3f direction{0.0f, 0.0f, -1.0f};  ///< unit, where the light shines to
  float cos_inner = 1.0f;
  float cos_outer = 0.70710678f;
};

struct Camera {
  std::string name;
  Matrix44f camera_to_world;  ///< looks along local -z, y up; rigid (scale removed)
  bool orthographic = false;
  float yfov = 0.7f;               ///< radians
  float xmag = 1.0f, ymag = 1.0f;  ///< orthographic half-extents, metres
  float aspect_ratio = 0.0f;       ///< 0: follow the image; else kept by fitting the view into the image
  float lens_radius = 0.0f;        ///< metres; 0: pinhole (from the job, glTF has none)
  float focus_distance = 1.0f;     ///< metres along the view axis
};

/// Light from outside the scene: a latitude-longitude map (y up, u=0.5 looks along -z... see environment.h) or
/// constant.
struct Environment {
  std::string file;                ///< absolute path of .hdr/.exr, or empty
  Rgb radiance{0.0f, 0.0f, 0.0f};  ///< constant radiance, or scale of the map
  [[nodiscard]] bool present() const { return !file.empty() || !is_zero(radiance); }
};

struct SceneDescription {
  std::vector<Mesh> meshes;
  std::vector<MeshInstance> instances;
  std::vector<Material> materials;  ///< never empty; index 0 may be glTF's default material
  std::vector<Texture> textures;
  std::vector<PunctualLight> lights;
  std::vector<Camera> cameras;  ///< in document order; never empty after loading (a framed one is made)
  Environment environment;
  std::vector<std::string> warnings;  ///< each one line naming file and place
};

}  // namespace pf
