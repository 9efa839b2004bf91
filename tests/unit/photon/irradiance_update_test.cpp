#include "worker/photon/irradiance_update.h"

#include <gtest/gtest.h>

#include <vector>

#include "common/math/sampling.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

std::vector<ScenePart> parts_of(const SceneMaker& maker) {
  auto parts = scene_parts(maker.description);
  EXPECT_TRUE(parts);
  return *parts;
}

SceneMaker room_with_ball(float x) {
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.lambert({0.5f, 0.5f, 0.5f}), true);
  maker.sphere({x, 0, 0}, 0.2f, maker.lambert({0.8f, 0.2f, 0.2f}), 8);
  maker.point_light({0, 0.9f, 0}, 1.0f);
  maker.camera({0, 0, 0.9f}, {0, 0, 0}, 1.0f);
  return maker;
}

TEST(SceneParts, OfEqualScenesAreEqual) {
  const SceneChange change = change_between(parts_of(room_with_ball(0)), parts_of(room_with_ball(0)));
  EXPECT_TRUE(change.empty());
}

TEST(SceneParts, OfAMovedObjectAreItsOldAndNewPlace) {
  const SceneChange change = change_between(parts_of(room_with_ball(0)), parts_of(room_with_ball(0.5f)));
  ASSERT_EQ(change.boxes.size(), 2u);
  EXPECT_TRUE(change.holds({0.65f, 0, 0}));
  EXPECT_TRUE(change.holds({-0.15f, 0, 0}));
  EXPECT_FALSE(change.holds({0.25f, 0, 0}));
  EXPECT_FALSE(change.everywhere);
  EXPECT_TRUE(change.gone_lights.empty());
}

TEST(SceneParts, TellEveryChangeOfAMaterialOrLight) {
  const auto before = parts_of(room_with_ball(0));
  const auto changes = [&](auto&& edit) {
    SceneMaker maker = room_with_ball(0);
    edit(maker.description);
    return !change_between(before, parts_of(maker)).empty();
  };
  EXPECT_FALSE(changes([](SceneDescription& d) { d.materials[1].name = "other"; }));
  EXPECT_TRUE(changes([](SceneDescription& d) { d.materials[1].base_color.x = 0.81f; }));
  EXPECT_TRUE(changes([](SceneDescription& d) { d.materials[1].roughness = 0.5f; }));
  EXPECT_TRUE(changes([](SceneDescription& d) { d.materials[1].emission = {0, 0, 1}; }));
  EXPECT_TRUE(changes([](SceneDescription& d) { d.materials[1].sheen_color.y = 0.1f; }));
  EXPECT_TRUE(changes([](SceneDescription& d) { d.meshes.back().positions[3].x += 1e-3f; }));
  EXPECT_TRUE(changes([](SceneDescription& d) { d.meshes.back().normals.clear(); }));
  EXPECT_TRUE(changes([](SceneDescription& d) { d.lights[0].intensity.y = 2.0f; }));
  EXPECT_TRUE(changes([](SceneDescription& d) { d.lights.clear(); }));
  EXPECT_TRUE(changes([](SceneDescription& d) { d.environment.radiance = {1, 1, 1}; }));
}

TEST(SceneChange, IsCrossedBySegmentsThatReachABox) {
  SceneChange change;
  change.boxes.push_back({{1, -1, -1}, {2, 1, 1}});
  float enter = 0.0f;
  EXPECT_TRUE(change.crossed({0, 0, 0}, {1, 0, 0}, 1.5f, &enter));
  EXPECT_FLOAT_EQ(enter, 1.0f);
  EXPECT_FALSE(change.crossed({0, 0, 0}, {1, 0, 0}, 0.9f));
  EXPECT_FALSE(change.crossed({0, 0, 0}, {-1, 0, 0}, 10.0f));
  EXPECT_TRUE(change.crossed({1.5f, 0, 0}, {0, 1, 0}, 0.1f, &enter));
  EXPECT_EQ(enter, 0.0f);
  EXPECT_FALSE(change.crossed({0, 2, 0}, normalize(Vec3f{1, 0, 0}), kInfinity));
  // Against points of random segments.
  PathRng rng(1, Stream::kTest, 0, 0);
  for (int i = 0; i < 3000; ++i) {
    const Vec3f origin = Vec3f{rng.next1(), rng.next1(), rng.next1()} * 4.0f - Vec3f{1, 2, 2};
    const Vec3f direction = sample_sphere(rng.next2());
    const float length = 3.0f * rng.next1();
    bool inside = false;
    for (int k = 0; k <= 3000; ++k)
      inside = inside || change.holds(origin + direction * (length * static_cast<float>(k) / 3000.0f));
    if (inside) {
      ASSERT_TRUE(change.crossed(origin, direction, length));
    }
  }
}

/// Two rooms beside each other, without a door.
SceneMaker two_rooms(bool lamp_on_the_right) {
  SceneMaker maker;
  const int grey = maker.lambert({0.6f, 0.6f, 0.6f});
  maker.box({-2.1f, 0, -1}, {-0.1f, 1, 1}, grey, true);
  maker.box({0.1f, 0, -1}, {2.1f, 1, 1}, grey, true);
  maker.point_light({-1, 0.9f, 0}, 1.0f);
  if (lamp_on_the_right) maker.point_light({1, 0.9f, 0}, 1.0f);
  maker.camera({-1, 0.5f, 0.9f}, {-1, 0, 0}, 1.0f);
  return maker;
}

TEST(ChangedLight, OfALampStaysInItsRoom) {
  const SceneMaker without = two_rooms(false), with = two_rooms(true);
  for (const bool added : {true, false}) {
    const auto scene = (added ? with : without).build();
    const SceneChange change =
        added ? change_between(parts_of(without), parts_of(with)) : change_between(parts_of(with), parts_of(without));
    EXPECT_EQ(change.gone_lights.size(), added ? 0u : 1u);
    const ChangedLight light(*scene, change, 0, 1);
    for (float z = -0.9f; z < 1.0f; z += 0.3f) {
      // Irradiance on the floor below a point light of 1 W/sr is cos^3 / h^2, reflected 0.6 / pi of it; more
      // comes by bounces.
      EXPECT_GT(light.radiance({1.0f, 0.0f, z}), 0.05f) << added;
      EXPECT_EQ(light.radiance({-1.0f, 0.0f, z}), 0.0f) << added;
    }
  }
}

TEST(ChangedLight, OfNoChangeIsNone) {
  const auto scene = two_rooms(true).build();
  const ChangedLight light(*scene, SceneChange{}, 0, 1);
  for (float x = -2.0f; x <= 2.0f; x += 0.1f) EXPECT_EQ(light.radiance({x, 0, 0}), 0.0f);
}

TEST(ChangedLight, BoundsTheShadowThatAnObjectLeaves) {
  // A ball below the lamp goes away: the floor there was dark and is lit now.
  const SceneMaker before = room_with_ball(0);
  SceneMaker after = room_with_ball(0);
  after.description.instances.pop_back();
  const auto scene = after.build();
  const ChangedLight light(*scene, change_between(parts_of(before), parts_of(after)), 1, 1);
  const double lit = 0.5 / double{kPi} / (1.9 * 1.9);
  EXPECT_GE(double{light.radiance({0.02f, -1, 0.02f})}, 0.5 * lit);
  // Beyond the shadow and one bounce nothing is brought or taken, but what the ball may have scattered.
  EXPECT_LT(double{light.radiance({0.9f, -1, 0.9f})}, 0.2 * lit);
}

TEST(ChangedPart, CountsRaysThatCrossAndWhatOthersSee) {
  const SceneMaker before = two_rooms(false), after = two_rooms(true);
  const auto scene = after.build();
  const SceneChange change = change_between(parts_of(before), parts_of(after));
  const ChangedLight light(*scene, change, 0, 1);
  const auto part_at = [&](const Vec3f& position) {
    IrradianceRecord record;
    record.position = position;
    record.normal = {0, 1, 0};
    record.rays = 64;
    const HemisphereGrid grid = record.grid();
    HemisphereSamples samples{grid, std::vector<Rgb>(grid.cells(), Rgb{1, 1, 1}), std::vector<float>(grid.cells())};
    for (std::uint32_t cell = 0; cell < grid.cells(); ++cell) {
      PathRng rng(9, Stream::kIrradiance, 0, cell);
      const Vec3f direction = Frame::from_normal(record.normal).to_world(grid.direction(cell, rng.next2()));
      const auto hit = scene->intersect({position + Vec3f{0, 1e-4f, 0}, direction});
      samples.distance[cell] = hit ? hit->t : kInfinity;
    }
    return changed_part(record, RecordReach(samples), 9, change, light);
  };
  EXPECT_GT(part_at({1, 0, 0.3f}), kTouchedPart);
  EXPECT_EQ(part_at({-1, 0, 0.3f}), 0.0f);
}

}  // namespace
}  // namespace pf::test
