#include "worker/plan/plan.h"

#include <gtest/gtest.h>

#include "tests/unit/plan/plan_scenes.h"

namespace pf {
namespace {

using namespace plan_test;

JobSpec job(IntegratorType type = IntegratorType::kAuto) {
  JobSpec spec;
  spec.job.name = "test";
  spec.scene.file = "test.gltf";
  spec.integrator.type = type;
  return spec;
}

Plan planned(const SceneDescription& scene, const JobSpec& spec = job()) {
  return make_plan(spec, gather_facts(scene));
}

const Decision& decision(const Plan& plan, std::string_view subject) {
  for (const Decision& d : plan.decisions) {
    if (d.subject == subject) return d;
  }
  ADD_FAILURE() << "no decision about " << subject;
  static const Decision kNone;
  return kNone;
}

TEST(Plan, TracesPathsWhereNothingFocusesLight) {
  SceneDescription scene = floor_scene();
  scene.lights.push_back(point_light(Vec3f(0, 5, 0)));
  const Plan plan = planned(scene);
  EXPECT_EQ(plan.algorithm, IntegratorType::kPath);
  EXPECT_FALSE(plan.caustic_statistics);
  EXPECT_TRUE(plan.warnings.empty());
}

TEST(Plan, TracesPhotonsWhereASmallLightMeetsGlass) {
  SceneDescription scene = floor_scene();
  add_quad(scene, glass(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  scene.lights.push_back(point_light(Vec3f(0, 5, 0)));
  const Plan plan = planned(scene);
  EXPECT_EQ(plan.algorithm, IntegratorType::kSppm);
  EXPECT_TRUE(plan.caustic_statistics);
  EXPECT_NE(decision(plan, "algorithm").reason.find("(glass)"), std::string::npos);
}

TEST(Plan, TracesPathsWhereGlassIsLitByTheSkyAlone) {
  SceneDescription scene = floor_scene();
  add_quad(scene, glass(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  scene.environment.radiance = Rgb(1, 1, 1);
  const Plan plan = planned(scene);
  EXPECT_EQ(plan.algorithm, IntegratorType::kPath);
  EXPECT_TRUE(plan.environment);
}

TEST(Plan, TracesPhotonsWhereALampStandsInGlass) {
  SceneDescription scene = floor_scene();
  Material frosted = glass();
  frosted.roughness = 0.9f;  // focuses nothing, but hides the lamp
  add_quad(scene, frosted, placed(Vec3f(0.5f, 1, 0.5f), Vec3f(0, 5, 0)));
  scene.lights.push_back(point_light(Vec3f(0, 5, 0)));
  EXPECT_EQ(planned(scene).algorithm, IntegratorType::kSppm);
}

TEST(Plan, KeepsCausticStatisticsOnlyWhereASpecularSurfaceIsReached) {
  SceneDescription scene = floor_scene();
  add_quad(scene, mirror(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  add_quad(scene, lamp(1), placed(Vec3f(0.1f, 1, 0.1f), Vec3f(0, 5, 0)));  // shines up, away from the mirror
  const Plan hidden = planned(scene, job(IntegratorType::kSppm));
  EXPECT_EQ(hidden.algorithm, IntegratorType::kSppm);
  EXPECT_FALSE(hidden.caustic_statistics);
  EXPECT_EQ(decision(hidden, "caustic statistics").reason, "no light reaches a surface that focuses it");
  scene.instances.back().object_to_world = facing_down(Vec3f(0.1f, 1, 0.1f), Vec3f(0, 5, 0));
  EXPECT_TRUE(planned(scene, job(IntegratorType::kSppm)).caustic_statistics);
  EXPECT_FALSE(planned(scene, job(IntegratorType::kPath)).caustic_statistics);
}

TEST(Plan, SwitchesOnOnlyTheTermsThatTheSceneNeeds) {
  SceneDescription scene = floor_scene();
  scene.lights.push_back(point_light(Vec3f(0, 5, 0)));
  const Plan bare = planned(scene);
  EXPECT_FALSE(bare.environment || bare.textures || bare.normal_maps || bare.alpha || bare.rough_lobes ||
               bare.media || bare.depth_of_field);

  scene.textures.resize(1);
  Material& m = scene.materials[0];
  m.base_color_texture.texture = m.normal_texture.texture = 0;
  m.alpha_mode = AlphaMode::kBlend;
  m.specular = 1;
  Material tinted = glass();
  tinted.attenuation_color = Rgb(1, 0.5f, 0.5f);
  tinted.attenuation_distance = 1;
  add_quad(scene, tinted, placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  scene.environment.file = "sky.hdr";
  JobSpec spec = job();
  spec.scene.lens_radius = 0.01;
  const Plan full = planned(scene, spec);
  EXPECT_TRUE(full.environment && full.textures && full.normal_maps && full.alpha && full.rough_lobes &&
              full.media && full.depth_of_field);
}

TEST(Plan, GivesEveryDecisionAReason) {
  for (const Decision& d : planned(floor_scene()).decisions) {
    EXPECT_FALSE(d.reason.empty()) << d.subject;
    EXPECT_FALSE(d.choice.empty()) << d.subject;
  }
}

TEST(Plan, WarnsOfASceneWithoutLight) {
  const Plan plan = planned(floor_scene());
  ASSERT_EQ(plan.warnings.size(), 1U);
  EXPECT_NE(plan.warnings[0].find("has no light"), std::string::npos);
}

TEST(Plan, TakesTheAlgorithmThatTheJobNames) {
  for (const IntegratorType type : {IntegratorType::kPath, IntegratorType::kPhotonMap, IntegratorType::kFinalGather,
                                    IntegratorType::kIrradianceCache, IntegratorType::kPhotonSplat, IntegratorType::kPpm,
                                    IntegratorType::kSppm}) {
    EXPECT_EQ(make_plan(job(type), gather_facts(floor_scene())).algorithm, type);
  }
}

TEST(Plan, ReadsTheSameInWordsAndAsJson) {
  SceneDescription scene = floor_scene();
  add_quad(scene, glass(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  scene.lights.push_back(point_light(Vec3f(0, 5, 0)));
  const SceneFacts facts = gather_facts(scene);
  const JobSpec spec = job();
  const Plan plan = make_plan(spec, facts);
  const std::string text = plan_text(spec, facts, plan);
  const nlohmann::json json = plan_json(spec, facts, plan);
  EXPECT_EQ(text.substr(0, text.find('\n')), "test: sppm");
  EXPECT_EQ(json["plan"]["algorithm"], "sppm");
  EXPECT_EQ(json["job"]["job"]["name"], "test");
  EXPECT_EQ(json["scene"]["materials"]["glass"], 1);
  ASSERT_EQ(json["plan"]["decisions"].size(), plan.decisions.size());
  for (const Decision& d : plan.decisions) EXPECT_NE(text.find(d.reason), std::string::npos) << d.subject;
  EXPECT_NE(text.find("1 point light (12.57 W)"), std::string::npos);
  EXPECT_EQ(plan_line(plan).substr(0, 28), "sppm; caustic statistics on;");
}

TEST(Plan, IsTheSameForTheSameScene) {
  SceneDescription scene = floor_scene();
  add_quad(scene, mirror(), placed(Vec3f(1, 1, 1), Vec3f(0, 1, 0)));
  add_quad(scene, lamp(1), facing_down(Vec3f(0.1f, 1, 0.1f), Vec3f(0, 5, 0)));
  const SceneFacts facts = gather_facts(scene);
  const std::string once = plan_json(job(), facts, planned(scene)).dump();
  EXPECT_EQ(once, plan_json(job(), gather_facts(scene), planned(scene)).dump());
}

}  // namespace
}  // namespace pf
