#include "worker/plan/plan.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "tests/support/scenes.h"

namespace pf::test {
namespace {

JobSpec auto_job(IntegratorType type = IntegratorType::kAuto) { return job(64, 48, type, 0); }

Plan planned(const SceneMaker& maker, const JobSpec& spec = auto_job()) {
  const auto scene = maker.build();
  return make_plan(spec, gather_facts(maker.description), fly_pilot(*scene, scene->cameras().front(), spec));
}

const Decision& decision(const Plan& plan, std::string_view subject) {
  for (const Decision& d : plan.decisions) {
    if (d.subject == subject) return d;
  }
  ADD_FAILURE() << "no decision about " << subject;
  static const Decision kNone;
  return kNone;
}

bool weighs(const Plan& plan, IntegratorType method) {
  return std::any_of(plan.candidates.begin(), plan.candidates.end(),
                     [&](const Candidate& c) { return c.method == method; });
}

/// A pilot of a plain scene, half of whose light is indirect: tests change what shall decide.
Pilot plain_pilot() {
  Pilot pilot;
  pilot.flux = 1;
  pilot.photon_paths = 1000;
  pilot.photon_rays = 2;
  pilot.path_rays = 4;
  pilot.eye_rays = 2;
  pilot.gathers = 1;
  pilot.diffuse = 1;
  pilot.direct = 1;
  pilot.light[kIndirect] = pilot.path_light[kIndirect] = 1;
  pilot.path_noise = 0.1;
  pilot.direct_noise = 0.1;
  pilot.photon_noise[kIndirect] = 0.01;
  return pilot;
}

Plan planned(const Pilot& pilot, const JobSpec& spec = auto_job()) { return make_plan(spec, SceneFacts{}, pilot); }

TEST(Plan, TracesPathsUnderTheOpenSky) {
  SceneMaker maker = bare_floor();
  maker.environment({1, 1, 1});
  const Plan plan = planned(maker);
  EXPECT_EQ(plan.algorithm, IntegratorType::kPath);
  EXPECT_TRUE(plan.environment);
  EXPECT_FALSE(plan.caustic_map || plan.projection_map);
}

TEST(Plan, TracesPhotonsWhereLightGoesFromWallToWall) {
  const Plan plan = planned(diffuse_box(), job(160, 120, IntegratorType::kAuto, 0));
  EXPECT_EQ(plan.algorithm, IntegratorType::kSppm);
  EXPECT_NE(decision(plan, "algorithm").reason.find("path would take"), std::string::npos);
}

TEST(Plan, TracesPhotonsWhereALampWithoutSizeMeetsGlass) {
  SceneMaker maker = bare_floor();
  maker.sphere({0, 1, 0}, 0.4f, maker.glass(1.5f), 32);
  maker.directional_light({0, -1, 0}, 1);
  const Plan plan = planned(maker);
  EXPECT_EQ(plan.algorithm, IntegratorType::kSppm);
  EXPECT_TRUE(plan.caustic_map);
  EXPECT_NE(decision(plan, "algorithm").reason.find("lamps without size"), std::string::npos);
  SceneMaker sky = bare_floor();
  sky.sphere({0, 1, 0}, 0.4f, sky.glass(1.5f), 32);
  sky.environment({1, 1, 1});
  EXPECT_EQ(planned(sky).algorithm, IntegratorType::kPath);
}

TEST(Plan, TracesPhotonsWhereALampStandsInGlass) {
  SceneMaker maker = bare_floor();
  const int lamp = maker.emitter({1000, 1000, 1000});
  maker.sphere({0, 1, 0}, 0.01f, lamp, 8);
  maker.environment({0.01f, 0.01f, 0.01f});
  EXPECT_EQ(planned(maker).algorithm, IntegratorType::kPath);
  maker.sphere({0, 1, 0}, 0.1f, maker.glass(1.5f), 32);
  EXPECT_EQ(planned(maker).algorithm, IntegratorType::kSppm);
}

TEST(Plan, MakesACausticMapOnlyWhereLightMeetsAMirrorFirst) {
  SceneMaker maker = bare_floor();
  maker.directional_light({0, -1, 0}, 1);
  const JobSpec spec = auto_job(IntegratorType::kSppm);
  EXPECT_FALSE(planned(maker, spec).caustic_map);
  EXPECT_NE(decision(planned(maker, spec), "caustic map").reason.find("no lamp shines on"), std::string::npos);
  maker.quad({-0.5f, 1, -1}, {1, 0, 0}, {0, -0.5f, -0.5f}, maker.mirror());
  EXPECT_TRUE(planned(maker, spec).caustic_map);
  EXPECT_FALSE(planned(maker, auto_job(IntegratorType::kPath)).caustic_map);
}

TEST(Plan, AimsPhotonsOnlyWhereTheLampsSeeLittle) {
  Pilot pilot = plain_pilot();
  JobSpec spec = auto_job(IntegratorType::kPhotonMap);
  pilot.lost = 0.19;
  EXPECT_FALSE(planned(pilot, spec).projection_map);
  EXPECT_EQ(planned(pilot, spec).resolve(spec).photon_map.projection_map, Switch::kOff);
  pilot.lost = 0.21;
  EXPECT_TRUE(planned(pilot, spec).projection_map);
  EXPECT_EQ(planned(pilot, spec).resolve(spec).photon_map.projection_map, Switch::kAuto);
  SceneMaker maker = bare_floor();
  maker.point_light({0, 1, 0}, 1);
  EXPECT_TRUE(planned(maker, spec).projection_map);
  EXPECT_FALSE(planned(maker, auto_job(IntegratorType::kSppm)).projection_map);  // gains less than it costs
}

TEST(Plan, GuidesPhotonsOnlyWhereThatPays) {
  Pilot pilot = plain_pilot();
  pilot.photon_noise[kIndirect] = 0.2;
  pilot.emission.gain = 5;
  pilot.emission.rays_per_path = 3;
  const JobSpec spec = job(320, 240, IntegratorType::kSppm, 0);
  EXPECT_TRUE(planned(pilot, spec).guided_emission);
  EXPECT_EQ(planned(pilot, spec).resolve(spec).integrator.guide_emission, Switch::kOn);
  const auto guided_with = [&](const Pilot& changed) { return planned(changed, spec).guided_emission; };
  Pilot little = pilot;
  little.emission.gain = 1.4;
  EXPECT_FALSE(guided_with(little));
  EXPECT_EQ(planned(little, spec).resolve(spec).integrator.guide_emission, Switch::kOff);
  Pilot dear = pilot;
  dear.emission.rays_per_path = 200;
  EXPECT_FALSE(guided_with(dear)) << "longer paths take more time than their noise is worth";
  Pilot quiet = pilot;
  quiet.photon_noise[kIndirect] = 1e-5;
  EXPECT_FALSE(guided_with(quiet)) << "photons are not what makes the noise";
  EXPECT_FALSE(planned(pilot, auto_job(IntegratorType::kPath)).guided_emission);
  JobSpec asked = spec;
  asked.integrator.guide_emission = Switch::kOff;
  EXPECT_FALSE(planned(pilot, asked).guided_emission);
  asked.integrator.guide_emission = Switch::kOn;
  EXPECT_TRUE(planned(little, asked).guided_emission);
}

TEST(Plan, CachesIrradianceOnlyOnDiffuseSmoothAndLargeSurfaces) {
  Pilot pilot = plain_pilot();
  pilot.path_noise = 100;  // light through a keyhole ...
  pilot.direct_noise = 0.001;
  pilot.photon_noise[kIndirect] = 0.006;  // ... that few photons find
  JobSpec spec = job(240, 180, IntegratorType::kAuto, 0);
  spec.irradiance_cache.rays = 64;
  pilot.roughness = 0.24;
  EXPECT_EQ(planned(pilot, spec).algorithm, IntegratorType::kIrradianceCache);
  pilot.roughness = 0.26;
  EXPECT_FALSE(weighs(planned(pilot, spec), IntegratorType::kIrradianceCache));
  pilot.roughness = 0.24;
  pilot.diffuse = 0.89;
  EXPECT_FALSE(weighs(planned(pilot, spec), IntegratorType::kIrradianceCache));
  pilot.diffuse = 1;
  spec.irradiance_cache.rays = 65536;  // not worth its records here
  EXPECT_TRUE(weighs(planned(pilot, spec), IntegratorType::kIrradianceCache));
  EXPECT_EQ(planned(pilot, spec).algorithm, IntegratorType::kSppm);
}

TEST(Plan, PrefersPathsWhereBothTakeAsLong) {
  Pilot pilot = plain_pilot();
  pilot.photon_noise[kIndirect] = 0;
  pilot.path_rays = 1.0;
  pilot.path_rays =
      1.1 * forecast_sppm(auto_job(), pilot).judged_work() / forecast_path(auto_job(), pilot).judged_work();
  EXPECT_EQ(planned(pilot).algorithm, IntegratorType::kPath);
  pilot.path_rays *= 1.1;
  EXPECT_EQ(planned(pilot).algorithm, IntegratorType::kSppm);
}

TEST(Plan, NeverTracesPathsWhereTheyMissWhatShows) {
  Pilot pilot = plain_pilot();
  pilot.photon_noise[kIndirect] = 10;
  ASSERT_EQ(planned(pilot).algorithm, IntegratorType::kPath);
  pilot.delta_flux = 1;
  pilot.light[kCaustic] = 0.01;
  pilot.caustic_square = 0.9e-4;
  EXPECT_EQ(planned(pilot).algorithm, IntegratorType::kPath);
  pilot.caustic_square = 1.1e-4;
  EXPECT_EQ(planned(pilot).algorithm, IntegratorType::kSppm);
}

TEST(Plan, KeepsWhatTheJobSaysOutright) {
  SceneMaker maker = bare_floor();
  maker.directional_light({0, -1, 0}, 1);
  JobSpec spec = auto_job(IntegratorType::kPhotonMap);
  spec.photon_map.caustic_map = Switch::kOn;
  spec.photon_map.projection_map = Switch::kOn;
  const Plan on = planned(maker, spec);
  EXPECT_TRUE(on.caustic_map && on.projection_map);
  EXPECT_EQ(on.resolve(spec).photon_map.projection_map, Switch::kOn);
  spec.photon_map.caustic_map = Switch::kOff;
  EXPECT_FALSE(planned(maker, spec).caustic_map);
  for (const IntegratorType type :
       {IntegratorType::kPath, IntegratorType::kPhotonMap, IntegratorType::kFinalGather,
        IntegratorType::kIrradianceCache, IntegratorType::kPhotonSplat, IntegratorType::kPpm, IntegratorType::kSppm}) {
    EXPECT_EQ(planned(plain_pilot(), auto_job(type)).algorithm, type);
  }
}

TEST(Plan, SwitchesOnOnlyTheTermsThatTheSceneNeeds) {
  SceneMaker maker = bare_floor();
  maker.point_light({0, 5, 0}, 1);
  const Plan bare = planned(maker);
  EXPECT_FALSE(bare.environment || bare.textures || bare.normal_maps || bare.alpha || bare.rough_lobes || bare.media ||
               bare.depth_of_field);

  SceneFacts facts = gather_facts(maker.description);
  facts.lights.environment = true;
  facts.textures = facts.normal_maps = facts.rough_lobes = facts.media = 1;
  facts.materials.alpha_blend = 1;
  JobSpec spec = auto_job();
  spec.scene.lens_radius = 0.01;
  const Plan full = make_plan(spec, facts, plain_pilot());
  EXPECT_TRUE(full.environment && full.textures && full.normal_maps && full.alpha && full.rough_lobes && full.media &&
              full.depth_of_field);
}

TEST(Plan, GivesEveryDecisionAReason) {
  for (const IntegratorType type : {IntegratorType::kAuto, IntegratorType::kIrradianceCache}) {
    for (const Decision& d : planned(diffuse_box(), auto_job(type)).decisions) {
      EXPECT_FALSE(d.reason.empty()) << d.subject;
      EXPECT_FALSE(d.choice.empty()) << d.subject;
    }
  }
}

TEST(Plan, WarnsOfASceneWithoutLight) {
  const Plan plan = planned(bare_floor());
  ASSERT_EQ(plan.warnings.size(), 1U);
  EXPECT_NE(plan.warnings[0].find("has no light"), std::string::npos);
}

TEST(Plan, DoesNotChangeWithTheLengthOfTheJob) {
  const Pilot pilot = plain_pilot();
  JobSpec other = auto_job();
  other.stop.error = 1e-4;
  other.stop.passes = 1;
  other.stop.seconds = 3;
  EXPECT_EQ(plan_line(planned(pilot)), plan_line(planned(pilot, other)));
}

TEST(Plan, ReadsTheSameInWordsAndAsJson) {
  SceneMaker maker = bare_floor();
  maker.sphere({0, 1, 0}, 0.4f, maker.glass(1.5f), 32);
  maker.point_light({0, 5, 0}, 1);
  const JobSpec spec = auto_job();
  const auto scene = maker.build();
  const SceneFacts facts = gather_facts(maker.description);
  const Pilot pilot = fly_pilot(*scene, scene->cameras().front(), spec);
  const Plan plan = make_plan(spec, facts, pilot);
  const PilotTiming timing{0.1};
  const std::string text = plan_text(spec, facts, pilot, plan, timing);
  const nlohmann::json json = plan_json(spec, facts, pilot, plan, timing);
  EXPECT_NE(text.find(": sppm\n"), std::string::npos);
  EXPECT_EQ(json["plan"]["algorithm"], "sppm");
  EXPECT_EQ(json["scene"]["materials"]["glass"], 1);
  EXPECT_EQ(json["pilot"]["photon_paths"], pilot.photon_paths);
  ASSERT_EQ(json["plan"]["decisions"].size(), plan.decisions.size());
  for (const Decision& d : plan.decisions) EXPECT_NE(text.find(d.reason), std::string::npos) << d.subject;
  EXPECT_NE(text.find("1 point light (12.57 W)"), std::string::npos);
  EXPECT_NE(text.find("relMSE 0.01 after"), std::string::npos);
  const nlohmann::json& sppm = json["forecast"]["methods"]["sppm"];
  EXPECT_LE(sppm["seconds_least"], sppm["seconds"]);
  EXPECT_LE(sppm["seconds"], sppm["seconds_most"]);
  EXPECT_TRUE(json["forecast"]["methods"].contains("path"));
  EXPECT_EQ(plan_line(plan).substr(0, 5), "sppm;");
  EXPECT_NE(plan_line(plan).find("caustic map on"), std::string::npos);
}

TEST(Plan, ForecastsTheErrorThatTheJobStopsAt) {
  JobSpec spec = auto_job();
  spec.stop.error = 0.2;
  const Pilot pilot = plain_pilot();
  const nlohmann::json json = plan_json(spec, SceneFacts{}, pilot, planned(pilot, spec), PilotTiming{1});
  EXPECT_DOUBLE_EQ(json["forecast"]["relative_mse"], 0.04);
}

TEST(Plan, TakesAsManySamplesOfLampsAsPayForTheirRays) {
  Pilot pilot = plain_pilot();
  pilot.light_rays = 1;
  EXPECT_EQ(planned(pilot, auto_job(IntegratorType::kSppm)).light_samples, 1) << "they would leave all of the noise";
  pilot.light_noise_left = 0.1;
  const Plan plan = planned(pilot, auto_job(IntegratorType::kSppm));
  EXPECT_GT(plan.light_samples, 1);
  EXPECT_EQ(decision(plan, "light samples").choice, std::to_string(plan.light_samples));
  EXPECT_EQ(plan.resolve(auto_job()).integrator.light_samples, plan.light_samples);
  EXPECT_GT(planned(pilot, auto_job(IntegratorType::kIrradianceCache)).light_samples, 1);
  EXPECT_EQ(planned(pilot, auto_job(IntegratorType::kPath)).light_samples, 1);
  pilot.light_rays = 100;
  EXPECT_EQ(planned(pilot, auto_job(IntegratorType::kSppm)).light_samples, 1) << "they would cost more than they save";
  JobSpec asked = auto_job(IntegratorType::kSppm);
  asked.integrator.light_samples = 3;
  EXPECT_EQ(planned(pilot, asked).light_samples, 3);
}

}  // namespace
}  // namespace pf::test
