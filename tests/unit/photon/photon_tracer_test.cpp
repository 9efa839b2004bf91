#include "worker/photon/photon_tracer.h"

#include <memory>
#include <optional>
#include <vector>

#include <gtest/gtest.h>

#include "common/math/sampling.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_lanes.h"

namespace pf {
namespace {

TEST(PhotonTracer, ShootsTheRaysThatItCounts) {
  const auto scene = test::peer_box(16).build();
  const PhotonTracer tracer(*scene, {1, 20000, 0});
  EXPECT_EQ(tracer.rays_of(3).size(), tracer.trace(3).rays);
}

/// The room of the peers with a mesh placed twice (instances), smooth normals and flat ones.
std::unique_ptr<const Scene> mixed_scene() {
  test::SceneMaker maker = test::peer_box(16);
  const int instanced = static_cast<int>(maker.description.meshes.size()) - 1;
  MeshInstance again = maker.description.instances.back();
  again.mesh = instanced;
  again.object_to_world.translate(Vec3f(0.05f, 0.3f, -0.1f));
  maker.description.instances.push_back(again);
  return maker.build();
}

TEST(PhotonTracer, ItsRaysMeetTogetherWhatEachMeetsAlone) {
  const auto scene = mixed_scene();
  const std::vector<Ray> rays = PhotonTracer(*scene, {1, 20000, 0}).rays_of(0);
  std::size_t differ = 0, met = 0;  // where two triangles meet either may be found
  for (std::size_t first = 0; first + kLanes <= rays.size(); first += kLanes) {
    RayLanes packet{};
    for (std::size_t i = 0; i < kLanes; ++i) {
      packet.origin.set(i, rays[first + i].origin);
      packet.direction.set(i, rays[first + i].direction);
    }
    const unsigned lanes = kAllLanes & ~(1u << (first / kLanes % kLanes));
    SurfaceLanes points;
    scene->intersect({&packet, 1}, {&lanes, 1}, {&points, 1});
    EXPECT_EQ(points.hits & ~lanes, 0u);
    for_each_lane(lanes, [&](std::size_t i) {
      const auto alone = scene->intersect(rays[first + i]);
      const bool hit = (points.hits >> i & 1u) != 0;
      if (alone.has_value() != hit || (alone && alone->primitive != points.primitive[i])) {
        ++differ;
      } else if (alone) {
        const SurfacePoint together = points.point(i);
        EXPECT_NEAR(alone->t, together.t, 1e-5f);
        EXPECT_LT(length(alone->position - together.position), 1e-5f);
        EXPECT_LT(length(alone->ns - together.ns), 1e-4f);
        EXPECT_EQ(alone->ng, together.ng);
        EXPECT_EQ(alone->extent, together.extent);
        EXPECT_EQ(alone->material, together.material);
        ++met;
      }
    });
  }
  EXPECT_LE(differ, rays.size() / 1000);
  EXPECT_GT(met, rays.size() / 2);
}

TEST(PhotonLanes, DrawTheNumbersOfPhilox) {
  const PhotonNumbers numbers{0x123456789ABCDEFull, 0x100000007ull};
  const Uint8 path = {0, 1, 2, 3, 1000, 70000, 0xFFFFFFFFu, 5}, block = {0, 1, 2, 3, 4, 5, 6, 7};
  const auto drawn = numbers.draw(path, block);
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const std::array<std::uint32_t, 4> counter = {
        path[lane], 7u, 1u ^ (static_cast<std::uint32_t>(Stream::kPhoton) << 16), block[lane]};
    const auto bits = philox4x32(counter, {0x89ABCDEFu, 0x1234567u});
    for (std::size_t k = 0; k < 4; ++k) EXPECT_EQ(drawn[k][lane], to_unit_float(bits[k]));
  }
  EXPECT_EQ(numbers.late(path[5], 1), numbers.draw(path, Uint8{} + (PhotonNumbers::block_of(1) + 1))[0][5]);
}

TEST(PhotonLanes, ArePackedAsOnePhotonIs) {
  PathRng rng(3, Stream::kTest, 0, 0);
  for (int k = 0; k < 2000; ++k) {
    Vec3x8 position{}, flux{}, direction{}, normal{};
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Vec2f a = rng.next2(), b = rng.next2();
      position.set(i, {a.x, a.y, b.x});
      flux.set(i, {b.x, b.y, a.x});
      direction.set(i, sample_sphere(a));
      normal.set(i, sample_sphere(b));
    }
    const auto photons = make_photons(position, flux, direction, normal);
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Photon one = make_photon(position[i], flux[i], direction[i], normal[i]);
      EXPECT_EQ(photons[i].position, one.position);
      EXPECT_EQ(photons[i].flux, one.flux);
      EXPECT_EQ(photons[i].direction, one.direction);
      EXPECT_EQ(photons[i].normal, one.normal);
    }
  }
}

}  // namespace
}  // namespace pf
