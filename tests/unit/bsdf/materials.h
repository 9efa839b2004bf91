#pragma once

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "common/math/sampling.h"
#include "worker/bsdf/bsdf.h"

namespace pf::test {

struct NamedMaterial {
  std::string name;
  SurfaceParams params;
};

inline SurfaceParams lambert(const Rgb& base) {
  SurfaceParams p;
  p.base_color = base;
  p.specular = 0.0f;
  return p;
}
inline SurfaceParams plastic(float roughness) {
  SurfaceParams p;
  p.roughness = roughness;
  return p;
}
inline SurfaceParams metal(float roughness, const Rgb& base = Rgb(1.0f)) {
  SurfaceParams p;
  p.base_color = base;
  p.metallic = 1.0f;
  p.roughness = roughness;
  return p;
}
inline SurfaceParams glass(float roughness, float ior = 1.5f) {
  SurfaceParams p;
  p.roughness = roughness;
  p.transmission = 1.0f;
  p.thin_walled = false;
  p.ior = ior;
  return p;
}
inline SurfaceParams sheet(float roughness) {
  SurfaceParams p = glass(roughness);
  p.thin_walled = true;
  return p;
}
inline SurfaceParams coated(SurfaceParams p, float roughness, float weight = 1.0f) {
  p.clearcoat = weight;
  p.clearcoat_roughness = roughness;
  return p;
}
inline SurfaceParams with_sheen(SurfaceParams p, float roughness, const Rgb& color = Rgb(1.0f)) {
  p.sheen_color = color;
  p.sheen_roughness = roughness;
  return p;
}
inline SurfaceParams tilted(SurfaceParams p, float degrees) {
  const float a = degrees * kPi / 180.0f;
  p.ns = {std::sin(a), 0.0f, std::cos(a)};
  return p;
}

/// One of every kind of surface, base colour as light as allowed, mirrors included.
inline std::vector<NamedMaterial> all_materials() {
  SurfaceParams half_metal = plastic(0.4f);
  half_metal.metallic = 0.5f;
  half_metal.base_color = {0.9f, 0.6f, 0.3f};
  SurfaceParams mixed = glass(0.5f);
  mixed.transmission = 0.6f;
  mixed.base_color = {1.0f, 0.9f, 0.7f};
  SurfaceParams mixed_sheet = sheet(0.6f);
  mixed_sheet.transmission = 0.5f;
  SurfaceParams tinted = glass(0.6f);
  tinted.specular = 0.5f;
  tinted.specular_color = {1.0f, 0.4f, 0.2f};
  SurfaceParams colored = plastic(0.35f);
  colored.specular_color = {3.0f, 1.0f, 0.2f};
  SurfaceParams infinite = plastic(0.5f);
  infinite.ior = 0.0f;
  infinite.specular_color = {0.3f, 0.5f, 0.2f};
  SurfaceParams under_water = glass(0.45f, 1.5f);
  under_water.eta_outside = 1.33f;
  SurfaceParams bubble = glass(0.5f, 1.0f);
  bubble.eta_outside = 1.5f;
  SurfaceParams matched = glass(0.5f, 1.33f);
  matched.eta_outside = 1.33f;
  matched.transmission = 0.7f;
  SurfaceParams full = with_sheen(coated(mixed, 0.3f, 0.8f), 0.5f, {0.4f, 0.3f, 0.8f});
  full.metallic = 0.3f;
  return {{"Lambert", lambert(Rgb(1.0f))},
          {"PlasticRough", plastic(1.0f)},
          {"PlasticMedium", plastic(0.4f)},
          {"PlasticSmooth", plastic(0.0f)},
          {"PlasticColored", colored},
          {"PlasticInfiniteIor", infinite},
          {"MetalMirror", metal(0.0f)},
          {"MetalGlossy", metal(0.3f)},
          {"MetalRough", metal(1.0f)},
          {"HalfMetal", half_metal},
          {"GlassSmooth", glass(0.0f)},
          {"GlassGlossy", glass(0.35f)},
          {"GlassRough", glass(1.0f)},
          {"GlassTinted", tinted},
          {"GlassUnderWater", under_water},
          {"Bubble", bubble},
          {"GlassMixed", mixed},
          {"Matched", matched},
          {"SheetSmooth", sheet(0.0f)},
          {"SheetRough", sheet(0.5f)},
          {"SheetMixed", mixed_sheet},
          {"CoatedLambertRough", coated(lambert(Rgb(1.0f)), 0.4f)},
          {"CoatedLambertSmooth", coated(lambert(Rgb(1.0f)), 0.0f)},
          {"CoatedMetal", coated(metal(0.5f), 0.25f, 0.7f)},
          {"CoatedMirror", coated(metal(0.0f), 0.0f)},
          {"SheenOnLambert", with_sheen(lambert(Rgb(1.0f)), 0.4f)},
          {"SheenSharp", with_sheen(plastic(0.6f), 0.15f, {1.0f, 0.5f, 0.1f})},
          {"Full", full}};
}

/// Unit direction `degrees` away from +z in the xz plane turned by `azimuth` radians; above 90 degrees: from
/// below.
inline Vec3f at_angle(float degrees, float azimuth = 0.4f) {
  const float a = degrees * kPi / 180.0f;
  return {std::sin(a) * std::cos(azimuth), std::sin(a) * std::sin(azimuth), std::cos(a)};
}

class Random {
 public:
  explicit Random(std::uint32_t seed) : engine_(seed) {}
  float uniform() { return static_cast<float>(engine_() >> 8) * 0x1p-24f; }
  Vec2f square() {
    const float x = uniform();
    return {x, uniform()};
  }
  Vec3f sphere() { return sample_sphere(square()); }

 private:
  std::mt19937 engine_;
};

inline constexpr Portion kPortions[] = {Portion::kAll, Portion::kGather, Portion::kFollow};
inline constexpr Transport kTransports[] = {Transport::kRadiance, Transport::kFlux};

}  // namespace pf::test
