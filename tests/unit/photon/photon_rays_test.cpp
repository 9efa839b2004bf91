#include "worker/photon/photon_rays.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <gtest/gtest.h>

#include "common/math/frame.h"
#include "common/math/philox.h"
#include "common/math/sampling.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"

namespace pf::test {
namespace {

std::vector<PhotonSegment> segments_of(const PhotonRays& rays, std::uint64_t sub_pass = 0) {
  std::vector<PhotonSegment> segments;
  PhotonRays::Figures figures;
  rays.trace(sub_pass, 0, rays.options().paths, segments, figures);
  EXPECT_EQ(figures.faults.not_finite, 0u);
  return segments;
}

TEST(PhotonRays, EndWherePhotonTracerStoresPhotons) {
  const auto scene = peer_box(24).build();
  const PhotonOptions options{4, 5000, 16};
  const PhotonTracer tracer(*scene, options);
  const PhotonBatch photons = tracer.trace(3);
  const PhotonRays rays(*scene, options, true);
  std::vector<PhotonSegment> segments;
  PhotonRays::Figures figures;
  rays.trace(3, 0, options.paths, segments, figures);
  EXPECT_EQ(figures.rays, photons.rays);
  // Every stored photon, in the order of the positions, is the end of a segment of its flow.
  for (const Flow flow : {kCaustic, kIndirect}) {
    std::vector<float> ends, stored;
    for (const PhotonSegment& s : segments) {
      if (s.flow == flow) ends.push_back((s.origin + s.direction * s.length).x);
    }
    for (const Photon& photon : photons.flows[flow]) stored.push_back(photon.position.x);
    ASSERT_GT(stored.size(), 100u);
    std::sort(ends.begin(), ends.end());
    for (const float x : stored) {
      constexpr float kOffset = 1e-4f;  // segments begin on the surface, rays a little above it
      const auto it = std::lower_bound(ends.begin(), ends.end(), x - kOffset);
      ASSERT_TRUE(it != ends.end() && *it < x + kOffset) << x;
    }
  }
}

/// The kernels' areas at a plane against how many rays really cross a square metre of it: where all paths are like each
/// other the one is the count times the other.
double density_ratio(const Scene& scene, std::uint32_t paths, float height, float half) {
  const PhotonRays rays(scene, {7, paths, 3}, true);
  double crossing = 0.0, expected = 0.0;
  for (const PhotonSegment& s : segments_of(rays)) {
    if (s.direction.y >= 0.0f) continue;
    const float t = (height - s.origin.y) / s.direction.y;
    const Vec3f p = s.origin + s.direction * t;
    if (t < 0.0f || t > s.length + 1e-4f || std::abs(p.x) > half || std::abs(p.z) > half) continue;
    const Frame frame = Frame::from_normal(s.direction);
    PhotonDifferential d = s.differential;
    d.advance(t);
    // One over the density, across the ray, of the like of it; on the plane it is seen at a slant.
    const double area = std::sqrt(double{d.along(frame.t, frame.b).at_start.determinant()}) / std::abs(s.direction.y);
    crossing += 1.0;
    expected += 1.0 / (area / (double{s.share} * paths));
  }
  // Mean density of the paths' own estimates, against the count over the area.
  return (expected / crossing) / (crossing / (4.0 * double{half} * double{half}));
}

TEST(PhotonRays, TheDensityOfAPathIsThatOfTheRaysAroundIt) {
  // A point light and a mirror above it: all rays downwards come from one image of the light.
  SceneMaker mirror;
  mirror.quad({-3, 2, -3}, {6, 0, 0}, {0, 0, 6}, mirror.mirror());
  mirror.quad({-3, 0, 3}, {6, 0, 0}, {0, 0, -6}, mirror.lambert({0, 0, 0}));
  mirror.point_light({0, 1, 0}, 1.0f);
  mirror.camera({0, 1.5f, 3}, {0, 0, 0}, 1.0f);
  EXPECT_NEAR(density_ratio(*mirror.build(), 400000, 0.0f, 0.3f), 1.0, 0.03);
  // Two lights share the paths.
  mirror.point_light({0, 1, 0}, 3.0f);
  EXPECT_NEAR(density_ratio(*mirror.build(), 400000, 0.0f, 0.3f), 0.625, 0.03);  // (1/4)^2 + (3/4)^2
}

TEST(PhotonRays, ADirectionalLightAndASpotHaveTheirOwnDensities) {
  const auto with = [](const std::function<void(SceneMaker&)>& light) {
    SceneMaker maker;
    maker.quad({-1, 2, -1}, {2, 0, 0}, {0, 0, 2}, maker.mirror());
    maker.quad({2, 0, 1}, {1, 0, 0}, {0, 0, -2}, maker.lambert({0, 0, 0}));  // not in the light's way
    maker.camera({0, 1.5f, 3}, {0, 0, 0}, 1.0f);
    light(maker);
    return maker.build();
  };
  EXPECT_NEAR(density_ratio(*with([](SceneMaker& m) {
                m.directional_light({0, 1, 0}, 1.0f);
              }),
                            400000, 0.01f, 0.3f),
              1.0, 0.03);
  EXPECT_NEAR(density_ratio(*with([](SceneMaker& m) {
                m.spot_light({0, 1, 0}, {0, 1, 0}, 1.0f, 0.9f, 0.8f);
              }),
                            400000, 0.01f, 0.2f),
              1.0, 0.03);
}

TEST(PhotonRays, TheShapeOfASmoothSphereIsThatOfTheSphere) {
  for (const float radius : {0.05f, 1.0f}) {
    SceneMaker maker;
    maker.sphere({2, 1, -3}, radius, maker.mirror(), 96);
    maker.camera({0, 0, 5}, {0, 0, 0}, 1.0f);
    maker.point_light({0, 3, 0}, 1.0f);
    const auto scene = maker.build();
    PathRng rng(5, Stream::kTest, 0, 0);
    for (int i = 0; i < 200; ++i) {
      const Vec3f d = sample_sphere(rng.next2());
      const auto hit = scene->intersect({Vec3f(2, 1, -3) + d * (2.0f * radius), -d});
      ASSERT_TRUE(hit);
      const SurfaceShape shape = shape_around(*scene, *hit);
      // A displacement along the surface turns the normal by displacement / radius. Normals within a facet of a coarse
      // sphere change a little faster.
      for (const Vec3f& tangent : {shape.tangent_x, shape.tangent_y}) {
        const Vec3f change = shape.normal_change(tangent);
        EXPECT_NEAR(dot(change, tangent) * radius, 1.0f, 0.06f) << radius << " " << i;
      }
    }
  }
}

TEST(PhotonRays, AFlatWallHasNoShape) {
  const auto scene = diffuse_box().build();
  const auto hit = scene->intersect({scene->bounds().center(), {0, -1, 0}});
  ASSERT_TRUE(hit);
  EXPECT_TRUE(is_zero(shape_around(*scene, *hit).normal_by_x));
}

TEST(PhotonRays, KernelsGrowWithEachBounceAndWithFewerPaths) {
  const auto scene = diffuse_box().build();
  const PhotonRays rays(*scene, {3, 20000, 0}, true);
  const KernelRule rule{.photons = 64, .widest = 1e6f};
  std::array<double, 4> widths{};
  std::array<int, 4> counts{};
  float last_share = 0.0f;
  std::size_t bounce = 0;
  for (const PhotonSegment& s : segments_of(rays)) {
    const RayKernel kernel = kernel_of(s, 20000, rule);
    EXPECT_NEAR(kernel_of(s, 80000, rule).radius(0.0f), 0.5f * kernel.radius(0.0f), 1e-3f * kernel.radius(0.0f));
    // Shares only fall along a path.
    bounce = s.share < last_share ? bounce + 1 : 0;
    last_share = s.share;
    if (bounce >= widths.size()) continue;
    widths[bounce] += double{kernel.radius(s.length)};
    ++counts[bounce];
  }
  for (std::size_t b = 1; b < widths.size(); ++b) {
    ASSERT_GT(counts[b], 50);
    EXPECT_GT(widths[b] / counts[b], widths[b - 1] / counts[b - 1]);
  }
}

TEST(PhotonRays, NoKernelIsWiderThanItsBound) {
  const auto scene = peer_box(16).build();
  const PhotonRays rays(*scene, {3, 2000, 0}, true);
  for (const PhotonSegment& s : segments_of(rays)) {
    const RayKernel kernel = kernel_of(s, 2000, {.photons = 64, .widest = 0.1f});
    EXPECT_LE(std::max(kernel.radius(0.0f), kernel.radius(s.length)), 0.1002f);
  }
}

}  // namespace
}  // namespace pf::test
