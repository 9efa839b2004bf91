#include "worker/plan/scene_facts.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/unit/plan/plan_scenes.h"

namespace pf {
namespace {

using namespace plan_test;

TEST(SceneFacts, AnEmptySceneHasNoFacts) {
  const SceneFacts facts = gather_facts(SceneDescription{});
  EXPECT_EQ(facts.triangles, 0);
  EXPECT_FALSE(facts.lights.any());
  EXPECT_TRUE(facts.bounds.isEmpty());
}

TEST(SceneFacts, CountsStoredAndPlacedTriangles) {
  SceneDescription scene = floor_scene();
  scene.instances.push_back({0, placed(Vec3f(1, 1, 1), Vec3f(0, 3, 0))});
  scene.meshes.push_back(quad(0));  // never placed
  const SceneFacts facts = gather_facts(scene);
  EXPECT_EQ(facts.triangles, 2);
  EXPECT_EQ(facts.triangles_placed, 4);
  EXPECT_EQ(facts.meshes, 1);
  EXPECT_EQ(facts.instances, 2);
  EXPECT_EQ(facts.instanced_meshes, 1);
  EXPECT_EQ(facts.bounds.max, Vec3f(10, 3, 10));
  EXPECT_EQ(facts.cameras, std::vector<std::string>{"front"});
}

TEST(SceneFacts, CountsOnlyMaterialsInUse) {
  SceneDescription scene = floor_scene();
  scene.materials.push_back(glass());  // no mesh has it
  add_quad(scene, mirror(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  const SceneFacts facts = gather_facts(scene);
  EXPECT_EQ(facts.materials.diffuse, 1);
  EXPECT_EQ(facts.materials.metal, 1);
  EXPECT_EQ(facts.materials.glass, 0);
}

TEST(SceneFacts, TellsKindsOfMaterialApart) {
  SceneDescription scene = floor_scene();
  const Matrix44f here = placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0));
  add_quad(scene, glass(), here);
  Material window = glass();
  window.thickness = 0;
  add_quad(scene, window, here);
  Material plastic = diffuse();
  plastic.specular = 1;
  plastic.roughness = 0.1f;
  plastic.clearcoat = 0.5f;
  plastic.sheen_color = Rgb(1, 0, 0);
  add_quad(scene, plastic, here);
  Material rough_plastic = plastic;
  rough_plastic.roughness = 1;
  rough_plastic.alpha_mode = AlphaMode::kMask;
  add_quad(scene, rough_plastic, here);
  Material sign = diffuse();
  sign.unlit = true;
  sign.alpha_mode = AlphaMode::kBlend;
  add_quad(scene, sign, here);
  const MaterialCounts m = gather_facts(scene).materials;
  EXPECT_EQ(m.glass, 1);
  EXPECT_EQ(m.thin_glass, 1);
  EXPECT_EQ(m.glossy, 1);
  EXPECT_EQ(m.diffuse, 2);
  EXPECT_EQ(m.unlit, 1);
  EXPECT_EQ(m.emissive, 1);
  EXPECT_EQ(m.clearcoat, 2);
  EXPECT_EQ(m.sheen, 2);
  EXPECT_EQ(m.alpha_mask, 1);
  EXPECT_EQ(m.alpha_blend, 1);
}

TEST(SceneFacts, FluxOfAnEmitterFollowsItsPlacedArea) {
  SceneDescription scene = floor_scene();
  add_quad(scene, lamp(3), placed(Vec3f(2, 1, 0.5f), Vec3f(0, 5, 0)));  // 4 m x 1 m
  EXPECT_NEAR(gather_facts(scene).lights.emissive_flux, 3.14159265 * 3 * 4, 1e-4);
  scene.materials.back().double_sided = true;
  EXPECT_NEAR(gather_facts(scene).lights.emissive_flux, 2 * 3.14159265 * 3 * 4, 1e-4);
}

TEST(SceneFacts, FluxOfPunctualLightsIsTheIntegralOfTheirIntensity) {
  SceneDescription scene = floor_scene();
  scene.lights.push_back(point_light(Vec3f(0, 5, 0), 2));
  PunctualLight spot = point_light(Vec3f(0, 5, 0), 2);
  spot.kind = PunctualKind::kSpot;
  spot.cos_inner = 0.9f;
  spot.cos_outer = 0.6f;
  scene.lights.push_back(spot);
  PunctualLight sun = point_light(Vec3f(0, 0, 0), 2);
  sun.kind = PunctualKind::kDirectional;
  scene.lights.push_back(sun);
  const LightCounts lights = gather_facts(scene).lights;
  EXPECT_NEAR(lights.point_flux, 4 * 3.14159265 * 2, 1e-4);
  // Midpoint rule over the cosine of the smooth fall-off in KHR_lights_punctual.
  double integral = 0;
  constexpr int kSteps = 100000;
  for (int i = 0; i < kSteps; ++i) {
    const double c = -1 + 2 * (i + 0.5) / kSteps;
    const double fall = std::clamp((c - 0.6) / (0.9 - 0.6), 0.0, 1.0);
    integral += 2 * 3.14159265 * 2 * fall * fall * (2.0 / kSteps);
  }
  EXPECT_NEAR(lights.spot_flux, integral, 1e-3);
  EXPECT_NEAR(lights.directional_flux, 2 * 3.14159265 * 200, 1e-2);  // radius^2 = 10^2 + 10^2
}

TEST(SceneFacts, AConstantEnvironmentHasFluxAndAMapHasNone) {
  SceneDescription scene = floor_scene();
  scene.environment.radiance = Rgb(1, 1, 1);
  EXPECT_NEAR(gather_facts(scene).lights.environment_flux, 4 * 3.14159265 * 3.14159265 * 200, 1);
  EXPECT_FALSE(gather_facts(scene).lights.environment_map);
  scene.environment.file = "sky.hdr";
  EXPECT_EQ(gather_facts(scene).lights.environment_flux, 0);
  EXPECT_TRUE(gather_facts(scene).lights.environment_map);
}

TEST(SceneFacts, APointLightReachesEveryMirror) {
  SceneDescription scene = floor_scene();
  add_quad(scene, mirror(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  scene.lights.push_back(point_light(Vec3f(0, 5, 0)));
  const CausticFacts c = gather_facts(scene).caustics;
  EXPECT_EQ(c.casters, 1);
  EXPECT_EQ(c.reached_by_small, 1);
  EXPECT_EQ(c.smallest_light, 0);
  EXPECT_EQ(c.names, std::vector<std::string>{"mirror"});
}

TEST(SceneFacts, AnEmitterReachesOnlyWhatIsInFrontOfIt) {
  SceneDescription scene = floor_scene();
  add_quad(scene, mirror(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  add_quad(scene, lamp(1), placed(Vec3f(0.1f, 1, 0.1f), Vec3f(0, 5, 0)));  // shines up
  EXPECT_EQ(gather_facts(scene).caustics.reached_by_small, 0);
  scene.instances.back().object_to_world = facing_down(Vec3f(0.1f, 1, 0.1f), Vec3f(0, 5, 0));
  EXPECT_EQ(gather_facts(scene).caustics.reached_by_small, 1);
}

TEST(SceneFacts, AMirroredInstanceKeepsItsFrontSide) {
  SceneDescription scene = floor_scene();
  add_quad(scene, mirror(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  add_quad(scene, lamp(1), placed(Vec3f(-0.1f, 1, 0.1f), Vec3f(0, 5, 0)));  // mirrored in x, still shines up
  EXPECT_EQ(gather_facts(scene).caustics.reached_by_small, 0);
}

TEST(SceneFacts, ASpotReachesOnlyItsCone) {
  SceneDescription scene = floor_scene();
  add_quad(scene, mirror(), placed(Vec3f(0.1f, 1, 0.1f), Vec3f(8, 0, 0)));
  PunctualLight spot = point_light(Vec3f(0, 5, 0));
  spot.kind = PunctualKind::kSpot;
  spot.direction = Vec3f(0, -1, 0);
  spot.cos_outer = 0.9f;
  scene.lights.push_back(spot);
  EXPECT_EQ(gather_facts(scene).caustics.reached_by_small, 0);
  scene.lights.back().cos_outer = 0.1f;
  EXPECT_EQ(gather_facts(scene).caustics.reached_by_small, 1);
}

TEST(SceneFacts, LargeLightsAreToldFromSmallOnes) {
  SceneDescription scene = floor_scene();
  add_quad(scene, mirror(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  add_quad(scene, lamp(1), facing_down(Vec3f(4, 1, 4), Vec3f(0, 5, 0)));
  const CausticFacts c = gather_facts(scene).caustics;
  EXPECT_EQ(c.reached_by_small, 0);
  EXPECT_EQ(c.reached_by_large, 1);
  EXPECT_NEAR(c.smallest_light, 64 / (4 * 3.14159265 * 16), 1e-6);
}

TEST(SceneFacts, RoughAndFaintReflectionsCastNoCaustics) {
  SceneDescription scene = floor_scene();
  Material rough = mirror();
  rough.roughness = 0.8f;
  add_quad(scene, rough, placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  Material plastic = diffuse();
  plastic.specular = 1;
  plastic.roughness = 0;
  add_quad(scene, plastic, placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  scene.lights.push_back(point_light(Vec3f(0, 5, 0)));
  EXPECT_EQ(gather_facts(scene).caustics.casters, 0);
}

TEST(SceneFacts, FindsALightInsideGlassButNotUnderAWindow) {
  SceneDescription scene = floor_scene();
  add_quad(scene, glass(), placed(Vec3f(0.5f, 1, 0.5f), Vec3f(0, 5, 0)));
  scene.lights.push_back(point_light(Vec3f(0, 5, 0)));
  EXPECT_EQ(gather_facts(scene).caustics.lights_in_glass, 1);
  scene.instances.back().object_to_world = placed(Vec3f(10, 1, 10), Vec3f(0, 5, 0));
  EXPECT_EQ(gather_facts(scene).caustics.lights_in_glass, 0);
}

TEST(SceneFacts, CountsTexturesOnce) {
  SceneDescription scene = floor_scene();
  scene.textures.resize(3);
  scene.materials[0].base_color_texture.texture = 2;
  scene.materials[0].normal_texture.texture = 1;
  Material other = diffuse();
  other.base_color_texture.texture = 2;
  add_quad(scene, other, placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  const SceneFacts facts = gather_facts(scene);
  EXPECT_EQ(facts.textures, 2);
  EXPECT_EQ(facts.normal_maps, 1);
}

TEST(SceneFacts, AbsorptionNeedsAnInsideADistanceAndAColour) {
  SceneDescription scene = floor_scene();
  Material tinted = glass();
  tinted.attenuation_color = Rgb(1, 0.5f, 0.5f);
  add_quad(scene, tinted, placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  EXPECT_EQ(gather_facts(scene).media, 0);
  scene.materials.back().attenuation_distance = 0.5f;
  EXPECT_EQ(gather_facts(scene).media, 1);
  scene.materials.back().thickness = 0;
  EXPECT_EQ(gather_facts(scene).media, 0);
}

}  // namespace
}  // namespace pf
