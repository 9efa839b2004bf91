#include "worker/plan/pilot.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "tests/support/scenes.h"
#include "worker/plan/plan.h"

namespace pf::test {
namespace {

Pilot flown(const SceneMaker& maker, const JobSpec& spec = job(64, 48, IntegratorType::kAuto, 0)) {
  const auto scene = maker.build();
  return fly_pilot(*scene, scene->cameras().front(), spec);
}

std::string text_of(const Pilot& pilot) {
  const JobSpec spec = job(64, 48, IntegratorType::kAuto, 0);
  return plan_json(spec, SceneFacts{}, pilot, make_plan(spec, SceneFacts{}, pilot), PilotTiming{}).dump();
}

TEST(Pilot, IsTheSameOnAnyNumberOfThreads) {
  const SceneMaker maker = peer_box(24);
  std::vector<std::string> found;
  for (const int threads : {1, 2, 5}) {
    const tbb::global_control allowed(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    arena.execute([&] { found.push_back(text_of(flown(maker))); });
  }
  EXPECT_EQ(found[0], found[1]);
  EXPECT_EQ(found[0], found[2]);
}

TEST(Pilot, DoesNotHangOnTheJobsSeedOrStop) {
  JobSpec other = job(64, 48, IntegratorType::kAuto, 0);
  other.integrator.seed = 77;
  other.stop.passes = 1;
  other.stop.error = 0.5;
  EXPECT_EQ(text_of(flown(diffuse_box())), text_of(flown(diffuse_box(), other)));
}

TEST(Pilot, CountsPhotonsThatMeetNothing) {
  SceneMaker maker = bare_floor();
  maker.point_light({0, 1, 0}, 1);
  // The floor fills this part of the sphere around the lamp: a square pyramid of half angles atan(2).
  const double seen = 4 * std::asin(4.0 / 5.0) / (4 * 3.14159265358979);
  EXPECT_NEAR(flown(maker).lost, 1 - seen, 0.02);
}

TEST(Pilot, TracesMorePhotonsWhereFewReachASurface) {
  SceneMaker open = bare_floor();
  open.point_light({0, 1, 0}, 1);  // photons of the second hit on are stored: few, as no wall sends them back
  EXPECT_EQ(flown(open).photon_paths, kMostPilotBatches * kPilotPhotons);
  EXPECT_EQ(flown(diffuse_box()).photon_paths, kPilotPhotons);
}

TEST(Pilot, SeesThatALampWithoutSizeMakesCausticsThatPathsMiss) {
  SceneMaker maker = bare_floor();
  maker.sphere({0, 1, 0}, 0.4f, maker.glass(1.5f), 32);
  maker.directional_light({0, -1, 0}, 1);
  const Pilot pilot = flown(maker);
  EXPECT_EQ(pilot.delta_flux, 1);
  EXPECT_GT(pilot.light[kCaustic], 0);
  EXPECT_EQ(pilot.path_light[kCaustic], 0);
  EXPECT_EQ(pilot.missed(kCaustic), 1);
}

TEST(Pilot, SeesThatPathsFindTheCausticsOfTheSky) {
  SceneMaker maker = bare_floor();
  maker.sphere({0, 1, 0}, 0.4f, maker.glass(1.5f), 32);
  maker.environment({1, 1, 1});
  const Pilot pilot = flown(maker);
  EXPECT_EQ(pilot.sky_flux, 1);
  EXPECT_GT(pilot.light[kCaustic], 0);
  EXPECT_EQ(pilot.missed(kCaustic), 0);
}

TEST(Pilot, TellsWhatIsSeenFirst) {
  SceneMaker maker;
  maker.quad({-9, 0, 9}, {18, 0, 0}, {0, 0, -18}, maker.mirror());
  maker.camera({0, 4, 0.01f}, {0, 0, 0}, 0.9f);
  maker.point_light({0, 1, 0}, 1);
  EXPECT_DOUBLE_EQ(flown(maker).specular, 1);
  SceneMaker diffuse = bare_floor();
  diffuse.point_light({0, 1, 0}, 1);
  const Pilot pilot = flown(diffuse);
  EXPECT_EQ(pilot.specular + pilot.glossy, 0);
  EXPECT_NEAR(pilot.diffuse + pilot.nothing, 1, 1e-12);
}

TEST(Pilot, MeasuresTheNoiseOfDirectLightFromASampleToTheNext) {
  SceneMaker steady = bare_floor();
  steady.directional_light({0, -1, 0}, 1);
  EXPECT_LT(flown(steady).direct_noise, 0.05);  // the floor's edge alone
  EXPECT_GT(flown(diffuse_box()).path_noise, flown(diffuse_box()).direct_noise);
}

TEST(Pilot, TellsHowFastNoiseFallsFromGroupsOfSamples) {
  Pilot pilot;
  pilot.direct_noise = 1.0;
  pilot.direct_group_noise = 1.0 / 4;
  EXPECT_DOUBLE_EQ(pilot.direct_power(), 1.0);
  pilot.direct_group_noise = 1.0 / 8;
  EXPECT_DOUBLE_EQ(pilot.direct_power(), 1.5);
  pilot.direct_group_noise = 1.0 / 2;  // chance
  EXPECT_DOUBLE_EQ(pilot.direct_power(), 1.0);
  pilot.direct_group_noise = 0;
  EXPECT_DOUBLE_EQ(pilot.direct_power(), 1.5);
  EXPECT_GT(flown(diffuse_box()).direct_power(), 1.1) << "a lamp, sampled in a stratified way";
}

TEST(Pilot, TellsWhatMoreSamplesOfLampsWouldSave) {
  SceneMaker sky = bare_floor();
  sky.environment({1, 1, 1});
  const Pilot under_sky = flown(sky);
  EXPECT_LT(under_sky.light_noise_left, 0.5);
  EXPECT_NEAR(under_sky.light_rays, 0.5, 0.2) << "half the directions lie below the floor";
  SceneMaker sun = bare_floor();
  sun.directional_light({0, -1, 0}, 1);
  EXPECT_GT(flown(sun).light_noise_left, 0.9) << "a sun without size has no noise but the floor's edge";
  EXPECT_NEAR(flown(sun).light_rays, flown(sun).diffuse, 0.01);
}

TEST(Pilot, TeachesAGuideOnlyToMethodsThatHaveAUseForIt) {
  const auto scene = diffuse_box().build();
  Pilot noisy;
  noisy.eye_rays = noisy.photon_rays = 2;
  noisy.photon_noise[kIndirect] = 100;
  const auto paths = [&](IntegratorType type, Switch asked = Switch::kAuto) {
    JobSpec spec = job(16, 16, type);
    spec.integrator.guide_emission = asked;
    return fly_emission_pilot(*scene, scene->cameras().front(), spec, noisy).paths;
  };
  EXPECT_GT(paths(IntegratorType::kSppm), 0u);
  EXPECT_GT(paths(IntegratorType::kPpm), 0u);
  EXPECT_GT(paths(IntegratorType::kAuto), 0u);
  EXPECT_EQ(paths(IntegratorType::kPath), 0u);
  EXPECT_EQ(paths(IntegratorType::kPhotonMap, Switch::kOn), 0u);
  EXPECT_EQ(paths(IntegratorType::kSppm, Switch::kOff), 0u);
  noisy.photon_noise[kIndirect] = 1e-4;
  EXPECT_EQ(paths(IntegratorType::kSppm), 0u) << "one pass is enough without";
  EXPECT_GT(paths(IntegratorType::kSppm, Switch::kOn), 0u) << "the job asks for it";
}

}  // namespace
}  // namespace pf::test
