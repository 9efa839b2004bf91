#include "worker/photon/splat_kernel.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "common/math/philox.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

constexpr SplatKernel kKernels[] = {SplatKernel::kEpanechnikov, SplatKernel::kCone, SplatKernel::kGaussian};

SplatSample facing(const Vec3f& position, const Vec3f& normal) {
  SplatSample s;
  s.position = position;
  s.ng = s.ns = normal;
  return s;
}

/// A ray down the z axis whose kernel is an ellipse of these half axes all along.
RayKernel straight(float a, float b, const RayKernel::Plane& start = {}, const RayKernel::Plane& end = {},
                   float length = 1.0f) {
  return RayKernel({0, 0, 1}, {0, 0, -1}, length, {1, 0, 0}, {0, 1, 0}, {a * a, 0, b * b}, {}, {}, start, end);
}

TEST(KernelProfile, IntegratesToOneOverTheDisc) {
  for (const SplatKernel kind : kKernels) {
    const KernelProfile f(kind);
    constexpr int kSteps = 200000;
    double sum = 0.0;  // 2 * integral of f(u) u du
    for (int i = 0; i < kSteps; ++i) {
      const double u = (i + 0.5) / kSteps;
      sum += 2.0 * double{f(static_cast<float>(u * u))} * u / kSteps;
    }
    EXPECT_NEAR(sum, 1.0, 1e-6) << static_cast<int>(kind);
    EXPECT_EQ(f(1.0f), 0.0f);
    EXPECT_EQ(f(2.0f), 0.0f);
  }
}

TEST(KernelProfile, KnowsItsPartBeyondALine) {
  for (const SplatKernel kind : kKernels) {
    const KernelProfile f(kind);
    for (const float s : {0.0f, 0.11f, 0.4f, 0.73f, 0.95f}) {
      constexpr int kSteps = 1200;
      double sum = 0.0;
      for (int i = 0; i < kSteps; ++i) {
        for (int j = 0; j < kSteps; ++j) {
          const double x = 2.0 * (i + 0.5) / kSteps - 1.0, y = 2.0 * (j + 0.5) / kSteps - 1.0;
          if (x > double{s})
            sum += double{f(static_cast<float>(x * x + y * y))} * 4.0 / (kSteps * double{kSteps} * std::numbers::pi);
        }
      }
      EXPECT_NEAR(double{f.beyond(s)}, sum, 1e-3) << static_cast<int>(kind) << ' ' << s;
    }
    EXPECT_EQ(f.beyond(1.0f), 0.0f);
    EXPECT_EQ(f.beyond(kInfinity), 0.0f);
  }
}

TEST(KernelProfile, FallsFromTheAxisToTheRim) {
  for (const SplatKernel kind : kKernels) {
    const KernelProfile f(kind);
    for (float u = 0.01f; u < 1.0f; u += 0.01f) EXPECT_LT(f(u * u), f((u - 0.01f) * (u - 0.01f)));
  }
}

TEST(RayKernel, SpreadsAllOfItsFluxAcrossTheRayWhateverItsShape) {
  // Samples on a plane across the ray: the kernel's integral over the plane is one, for circles, ellipses, turned
  // ellipses, and with the eye's own footprint added.
  const Spread turned{0.010f, 0.004f, 0.003f};
  for (const float least : {0.0f, 0.05f}) {
    for (const SplatKernel kind : kKernels) {
      const RayKernel kernel({0, 0, 1}, {0, 0, -1}, 1.0f, {1, 0, 0}, {0, 1, 0}, turned, {}, {}, {}, {});
      const KernelProfile f(kind);
      constexpr int kSteps = 800;
      constexpr float kHalf = 0.2f;
      double sum = 0.0;
      for (int i = 0; i < kSteps * kSteps; ++i) {
        const auto at = [&](int k) { return kHalf * (2.0f * (static_cast<float>(k) + 0.5f) / kSteps - 1.0f); };
        SplatSample sample = facing({at(i % kSteps), at(i / kSteps), 0.5f}, {0, 0, 1});
        sample.least_radius = least;
        const auto meeting = kernel.meet(sample);
        if (meeting) sum += double{f(meeting->u2) / meeting->area} * std::pow(2.0 * double{kHalf} / kSteps, 2);
      }
      EXPECT_NEAR(sum, 1.0, 2e-3) << static_cast<int>(kind) << " " << least;
    }
  }
}

TEST(RayKernel, BringsAllOfItsFluxToATiltedSurfaceThatItMeets) {
  // Integral over the surface of kernel times cosine: one, however slanted, also where the eye's footprint is the wider
  // part.
  for (const float least : {0.0f, 0.1f}) {
    for (const float slope : {0.0f, 1.0f, 5.0f}) {
      const Vec3f normal = normalize(Vec3f{slope, 0.0f, 1.0f});
      const Vec3f along = normalize(Vec3f{1.0f, 0.0f, -slope});
      const RayKernel kernel = straight(0.04f, 0.04f, {}, {normal, 0.0f}, 1.0f);
      const KernelProfile f(SplatKernel::kEpanechnikov);
      constexpr int kSteps = 600;
      const float half_u = 0.15f / normal.z, half_v = 0.15f;
      double sum = 0.0;
      for (int i = 0; i < kSteps * kSteps; ++i) {
        const auto at = [&](int k) { return 2.0f * (static_cast<float>(k) + 0.5f) / kSteps - 1.0f; };
        SplatSample sample =
            facing(along * (half_u * at(i % kSteps)) + Vec3f(0.0f, half_v * at(i / kSteps), 0.0f), normal);
        sample.least_radius = least;
        const auto meeting = kernel.meet(sample);
        if (meeting)
          sum += double{f(meeting->u2) / meeting->area * normal.z} * 4.0 * double{half_u * half_v} / (kSteps * kSteps);
      }
      EXPECT_NEAR(sum, 1.0, 3e-3) << slope << " " << least;
    }
  }
}

TEST(RayKernel, KeepsToSamplesThatFaceTheRayNearIt) {
  const RayKernel kernel = straight(0.1f, 0.2f);
  EXPECT_TRUE(kernel.meet(facing({0.05f, 0.1f, 0.5f}, {0, 0, 1})));
  EXPECT_FALSE(kernel.meet(facing({0.05f, 0.1f, 0.5f}, {0, 0, -1})));
  EXPECT_FALSE(kernel.meet(facing({0.11f, 0.0f, 0.5f}, {0, 0, 1})));
  EXPECT_TRUE(kernel.meet(facing({0.0f, 0.19f, 0.5f}, {0, 0, 1})));
  EXPECT_FALSE(kernel.meet(facing({0.0f, 0.21f, 0.5f}, {0, 0, 1})));
  // A surface across the ray ends it, a little beyond for what bulges; without one the ray goes on.
  const RayKernel ended = straight(0.1f, 0.1f, {}, {{0, 0, 1}, 0.0f});
  EXPECT_FALSE(ended.meet(facing({0, 0, -0.11f}, {0, 0, 1})));
  EXPECT_TRUE(straight(0.1f, 0.1f).meet(facing({0, 0, -0.11f}, {0, 0, 1})));
  SplatSample thin = facing({0, 0, 0.5f}, {0, 0, -1});
  thin.both_sides = true;
  EXPECT_TRUE(kernel.meet(thin));
}

TEST(RayKernel, FollowsATiltedSurfaceBeyondTheRaysEndButNotBehindIt) {
  // A wall met at a slant: samples on it count all over the kernel; those well behind it are told apart.
  const Vec3f normal = normalize(Vec3f{3.0f, 0.0f, 1.0f});
  const RayKernel kernel = straight(0.1f, 0.1f, {}, {normal, 0.0f});
  const Vec3f along = normalize(Vec3f{1.0f, 0.0f, -3.0f});
  for (const float s : {-0.25f, 0.25f}) {
    const auto meeting = kernel.meet(facing(along * s, normal));
    ASSERT_TRUE(meeting) << s;
    EXPECT_EQ(meeting->behind, 0.0f);
  }
  const auto behind = kernel.meet(facing({-0.05f, 0.0f, 0.0f}, {0, 0, 1}));
  ASSERT_TRUE(behind);
  EXPECT_NEAR(behind->behind, 0.15f, 1e-4f);  // back along the ray to the wall's plane
}

TEST(RayKernel, LeavesOutWhatLiesBehindTheSurfaceThatItLeft) {
  const Vec3f normal = normalize(Vec3f{1.0f, 0.0f, -1.0f});
  const RayKernel kernel = straight(0.1f, 0.1f, {normal, dot(normal, Vec3f{0, 0, 1})});
  EXPECT_TRUE(kernel.meet(facing({0.08f, 0.0f, 1.05f}, {0, 0, 1})));
  EXPECT_FALSE(kernel.meet(facing({-0.08f, 0.0f, 0.99f}, {0, 0, 1})));
}

TEST(RayKernel, LightFromTheUndersideOfASheetDoesNotShowOnItsTop) {
  // The ray leaves a sheet downwards; samples on the sheet's top face it, yet nothing of it arrives there.
  const RayKernel kernel = straight(0.1f, 0.1f, {{0, 0, -1}, -1.0f});
  EXPECT_FALSE(kernel.meet(facing({0.05f, 0, 1.0f}, {0, 0, 1})));
  EXPECT_FALSE(kernel.meet(facing({0.05f, 0, 1.01f}, {0, 0, 1})));  // nor on top of one with a thickness
  EXPECT_TRUE(kernel.meet(facing({0.05f, 0, 0.99f}, {0, 0, 1})));   // but on what lies below it
  SplatSample glass = facing({0.05f, 0, 1.0f}, {0, 0, -1});
  glass.both_sides = true;
  EXPECT_FALSE(kernel.meet(glass));
}

TEST(RayKernel, ItsConeBoundsItsEllipseEverywhere) {
  PathRng rng(3, Stream::kTest, 0, 0);
  for (int i = 0; i < 2000; ++i) {
    // Two random derivatives: spreads that may shrink to a focus and grow again.
    Spread at_start, linear, quadratic;
    for (int k = 0; k < 2; ++k) {
      const Vec2f p = rng.next2() - Vec2f(0.5f), d = rng.next2() - Vec2f(0.5f);
      at_start += Spread{p.x * p.x, p.x * p.y, p.y * p.y};
      linear += Spread{2 * p.x * d.x, p.x * d.y + p.y * d.x, 2 * p.y * d.y};
      quadratic += Spread{d.x * d.x, d.x * d.y, d.y * d.y};
    }
    const float length = 4.0f * rng.next1();
    const RayKernel kernel({0, 0, 0}, {0, 0, 1}, length, {1, 0, 0}, {0, 1, 0}, at_start, linear, quadratic, {}, {});
    for (float part = 0.0f; part <= 1.0f; part += 0.05f) {
      EXPECT_LE(std::sqrt(kernel.spread(part * length).largest()), kernel.radius(part * length) * 1.0001f + 1e-4f);
    }
  }
}

}  // namespace
}  // namespace pf
