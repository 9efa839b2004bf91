#include "worker/photon/photon_tracer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <memory>
#include <optional>
#include <vector>

#include <gtest/gtest.h>

#include "common/math/sampling.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_lanes.h"
#include "worker/photon/photon_pool.h"

namespace pf {
namespace {

TEST(PhotonTracer, ShootsTheRaysThatItCounts) {
  const auto scene = test::peer_box(16).build();
  const PhotonTracer tracer(*scene, {1, 20000, 0});
  EXPECT_EQ(tracer.rays_of(3).size(), tracer.trace(3).rays);
}

/// Paths that end sooner leave their places to others: nothing of that may be seen in a path's own rays.
TEST(PhotonTracer, SendsAPathTheSameWayWhateverItsCompany) {
  const auto scene = test::peer_box(16).build();
  const auto rays_of = [&](int max_depth) {
    std::vector<std::array<float, 6>> all;
    for (const Ray& ray : PhotonTracer(*scene, {1, 65536, max_depth}).rays_of(0)) {
      const Vec3f &o = ray.origin, &d = ray.direction;
      all.push_back({o.x, o.y, o.z, d.x, d.y, d.z});
    }
    std::sort(all.begin(), all.end());
    return all;
  };
  const auto unbounded = rays_of(0);
  for (const int depth : {2, 5, 9, 12}) {
    const auto bounded = rays_of(depth);
    EXPECT_LT(bounded.size(), unbounded.size());
    EXPECT_TRUE(std::includes(unbounded.begin(), unbounded.end(), bounded.begin(), bounded.end())) << depth;
  }
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

PhotonLanes photons_from(std::uint32_t path) {
  PhotonLanes photons;
  photons.path = Uint8{0, 1, 2, 3, 4, 5, 6, 7} + path;
  photons.bounce = reinterpret_cast<Int8>(photons.path) * 3;
  photons.specular_only = Int8{} - 1;
  for (std::size_t i = 0; i < kLanes; ++i) {
    const float x = static_cast<float>(photons.path[i]);
    photons.ray.origin.set(i, {x, x + 0.1f, x + 0.2f});
    photons.ray.direction.set(i, {x + 0.3f, x + 0.4f, x + 0.5f});
    photons.position.set(i, {x + 0.6f, x + 0.7f, x + 0.8f});
    photons.flux.set(i, {x + 0.9f, x + 0.95f, x + 0.99f});
  }
  return photons;
}

/// The photon that photons_from() puts where its path says.
void expect_whole(const PhotonLanes& photons, std::size_t lane) {
  const PhotonLanes expected = photons_from(photons.path[lane]);
  EXPECT_EQ(photons.ray.origin[lane], expected.ray.origin[0]);
  EXPECT_EQ(photons.ray.direction[lane], expected.ray.direction[0]);
  EXPECT_EQ(photons.position[lane], expected.position[0]);
  EXPECT_EQ(photons.flux[lane], expected.flux[0]);
  EXPECT_EQ(photons.bounce[lane], expected.bounce[0]);
  EXPECT_EQ(photons.specular_only[lane], -1);
}

TEST(PhotonPool, GivesWhatWentOnInOrderWhileItIsRefilled) {
  PathRng rng(9, Stream::kTest, 0, 0);
  PhotonPool pool(false);
  std::vector<std::uint32_t> inside;
  for (std::uint32_t path = 0; pool.has_room(); path += kLanes) {
    pool.add(kAllLanes, photons_from(path));
    for (std::uint32_t i = 0; i < kLanes; ++i) inside.push_back(path + i);
  }
  EXPECT_EQ(pool.size(), PhotonPool::kCapacity);
  while (!inside.empty()) {
    std::vector<std::uint32_t> next;
    const std::size_t waiting = pool.size();
    ASSERT_EQ(waiting, inside.size());
    pool.refill();
    for (std::size_t first = 0; first < waiting; first += kLanes) {
      PhotonLanes photons;
      pool.take(first, photons);
      unsigned on = 0;
      for (std::size_t i = 0; i < kLanes && first + i < waiting; ++i) {
        EXPECT_EQ(photons.path[i], inside[first + i]);
        expect_whole(photons, i);
        on |= rng.next1() < 0.9f ? 1u << i : 0;
      }
      // The last of them by itself, as what is neither matte nor smooth.
      const unsigned last = on == 0 ? 0 : std::bit_floor(on);
      pool.add(on & ~last, photons);
      for_each_lane(on & ~last, [&](std::size_t i) { next.push_back(photons.path[i]); });
      for_each_lane(last, [&](std::size_t i) {
        pool.add({{photons.ray.origin[i], photons.ray.direction[i]},
                  photons.position[i],
                  photons.flux[i],
                  photons.path[i],
                  photons.bounce[i],
                  true,
                  {}});
        next.push_back(photons.path[i]);
      });
    }
    inside = next;
  }
}

}  // namespace
}  // namespace pf
