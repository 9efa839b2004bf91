// Shading normals that would mirror light into the surface.
#include <gtest/gtest.h>

#include "tests/unit/bsdf/materials.h"

namespace pf::test {
namespace {

TEST(BsdfNormals, MirrorNeverSendsLightIntoTheSurface) {
  Random random(15);
  for (int i = 0; i < 20000; ++i) {
    const Vec3f wo = sample_cosine_hemisphere(random.square());
    const Bsdf bsdf(tilted(metal(0.0f), 60.0f * random.uniform()), wo);
    const auto s = bsdf.sample(wo, random.uniform(), random.square(), Transport::kRadiance);
    ASSERT_TRUE(s) << wo;
    ASSERT_GT(s->wi.z, 0.0f);
    ASSERT_EQ(s->weight, Rgb(1.0f));
  }
}

TEST(BsdfNormals, OnlyMirrorsThatPointIntoTheSurfaceAreTurned) {
  const Vec3f wo = at_angle(0.0f);
  for (const float degrees : {30.0f, 44.0f, 46.0f, 60.0f, 80.0f}) {
    const SurfaceParams p = tilted(metal(0.0f), degrees);
    const auto s = Bsdf(p, wo).sample(wo, 0.5f, {0.5f, 0.5f}, Transport::kRadiance);
    ASSERT_TRUE(s);
    const Vec3f mirrored = p.ns * (2.0f * dot(wo, p.ns)) - wo;
    if (degrees < 45.0f) {
      EXPECT_LT(length(s->wi - mirrored), 1e-5f) << degrees;
    } else {  // to just above the horizon, in the plane of the normals
      EXPECT_NEAR(s->wi.z, 0.0f, 0.03f) << degrees;
      EXPECT_NEAR(dot(cross(p.ng, p.ns), s->wi), 0.0f, 1e-5f) << degrees;
    }
  }
}

TEST(BsdfNormals, WhatIsMatteKeepsASteepNormal) {
  // Seen head-on a mirror of these normals would point into the surface.
  const Vec3f wo = at_angle(0.0f);
  for (const float degrees : {50.0f, 65.0f, 80.0f}) {
    SurfaceParams p = tilted(plastic(0.0f), degrees);
    p.sheen_color = Rgb(0.5f);
    p.sheen_roughness = 0.6f;
    const Bsdf bsdf(p, wo);
    EXPECT_LT(length(bsdf.ns() - p.ns), 1e-6f);
    SurfaceParams flat = p;
    flat.ng = p.ns;
    for (const float angle : {10.0f, 40.0f, 70.0f}) {
      const Vec3f wi = at_angle(angle);  // above both surfaces
      const Bsdf real(flat, wo);
      EXPECT_NEAR(bsdf.eval(wo, wi, Transport::kRadiance).x, real.eval(wo, wi, Transport::kRadiance).x, 1e-5f)
          << degrees << ' ' << angle;
    }
  }
}

}  // namespace
}  // namespace pf::test
