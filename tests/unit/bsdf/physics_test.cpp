// Reciprocity, energy and closed forms.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/bsdf/materials.h"
#include "worker/bsdf/albedo_table.h"
#include "worker/bsdf/fresnel.h"

namespace pf::test {
namespace {

void expect_close(const Rgb& a, const Rgb& b, float relative, const std::string& what) {
  for (int k = 0; k < 3; ++k) {
    ASSERT_NEAR(a[k], b[k], relative * (std::abs(a[k]) + std::abs(b[k])) + 2e-5f) << what;
  }
}

TEST(BsdfReciprocity, SwappingDirectionsSwapsRadianceAndFlux) {
  Random random(1);
  for (const NamedMaterial& m : all_materials()) {
    for (int i = 0; i < 4000; ++i) {
      const Vec3f a = random.sphere(), b = random.sphere();
      const Bsdf from_a(m.params, a), from_b(m.params, b);
      const Rgb f = from_a.eval(a, b, Transport::kRadiance);
      expect_close(f, from_b.eval(b, a, Transport::kFlux), 2e-3f, m.name);
      if (a.z * b.z > 0.0f) expect_close(f, from_b.eval(b, a, Transport::kRadiance), 2e-3f, m.name);
    }
  }
}

TEST(BsdfReciprocity, HoldsForTiltedNormalsThatNeedNoTurning) {
  Random random(2);
  for (const NamedMaterial& m : all_materials()) {
    SurfaceParams p = tilted(m.params, 8.0f);
    p.clearcoat_ns = tilted(m.params, -5.0f).ns;
    for (int i = 0; i < 4000; ++i) {
      const Vec3f a = random.sphere(), b = random.sphere();
      if (std::abs(a.z) < 0.35f || std::abs(b.z) < 0.35f) continue;
      expect_close(Bsdf(p, a).eval(a, b, Transport::kRadiance), Bsdf(p, b).eval(b, a, Transport::kFlux), 2e-3f, m.name);
    }
  }
}

TEST(BsdfReciprocity, RefractionIsSymmetricAfterDivisionBySquaredIndex) {
  Random random(3);
  for (const float roughness : {0.3f, 0.6f, 1.0f}) {
    const SurfaceParams p = glass(roughness);
    int lit = 0;
    for (int i = 0; i < 4000; ++i) {
      Vec3f a = random.sphere(), b = random.sphere();
      a.z = std::abs(a.z);
      b.z = -std::abs(b.z);
      const Rgb down = Bsdf(p, a).eval(a, b, Transport::kFlux) * (1.0f / (1.5f * 1.5f));
      const Rgb up = Bsdf(p, b).eval(b, a, Transport::kFlux);
      expect_close(down, up, 2e-3f, "glass");
      expect_close(Bsdf(p, a).eval(a, b, Transport::kRadiance), down, 2e-3f, "radiance shrinks by (eta_i/eta_t)^2");
      lit += down.x > 0.0f;
    }
    EXPECT_GT(lit, 500);
  }
}

/// Mean weight of sample(): the albedo seen from wo, flux conserved.
Rgb furnace(const SurfaceParams& p, const Vec3f& wo, Transport mode, int n, std::uint32_t seed,
            Portion portion = Portion::kAll) {
  Random random(seed);
  double sum[3] = {0, 0, 0};
  const Bsdf bsdf(p, wo);
  for (int i = 0; i < n; ++i) {
    const float u = (static_cast<float>(i) + random.uniform()) / static_cast<float>(n);
    if (const auto s = bsdf.sample(wo, u, random.square(), mode, portion)) {
      for (int k = 0; k < 3; ++k) sum[k] += s->weight[k];
    }
  }
  return {static_cast<float>(sum[0] / n), static_cast<float>(sum[1] / n), static_cast<float>(sum[2] / n)};
}

TEST(BsdfEnergy, NoMaterialReflectsMoreThanItReceives) {
  for (const NamedMaterial& m : all_materials()) {
    for (const float degrees : {1.0f, 30.0f, 60.0f, 75.0f, 85.0f, 89.0f, 95.0f, 120.0f, 150.0f, 179.0f}) {
      const Rgb e = furnace(m.params, at_angle(degrees), Transport::kFlux, 40000, 5);
      EXPECT_LE(max_component(e), 1.006f) << m.name << " at " << degrees;
    }
  }
}

TEST(BsdfEnergy, WhiteLambertMirrorGlassAndSheetLoseNothing) {
  const NamedMaterial lossless[] = {{"Lambert", lambert(Rgb(1.0f))},
                                    {"mirror", metal(0.0f)},
                                    {"glass", glass(0.0f)},
                                    {"sheet", sheet(0.0f)},
                                    {"coated mirror", coated(metal(0.0f), 0.0f)}};
  for (const NamedMaterial& m : lossless) {
    for (const float degrees : {0.0f, 20.0f, 50.0f, 80.0f, 89.9f, 100.0f, 130.0f, 170.0f}) {
      const Vec3f wo = at_angle(degrees);
      Random random(11);
      for (int i = 0; i < 500; ++i) {
        const Bsdf bsdf(m.params, wo);
        const auto s = bsdf.sample(wo, random.uniform(), random.square(), Transport::kFlux);
        ASSERT_TRUE(s) << m.name << degrees;
        for (int k = 0; k < 3; ++k) ASSERT_NEAR(s->weight[k], 1.0f, 2e-6f) << m.name << ' ' << degrees;
      }
    }
  }
}

TEST(BsdfEnergy, LambertAndMirrorWeightsAreExactlyOne) {
  const Vec3f wo = at_angle(50.0f);
  Random random(12);
  for (int i = 0; i < 1000; ++i) {
    for (const SurfaceParams& p : {lambert(Rgb(1.0f)), metal(0.0f)}) {
      for (const Transport mode : kTransports) {
        const auto s = Bsdf(p, wo).sample(wo, random.uniform(), random.square(), mode);
        ASSERT_TRUE(s);
        ASSERT_EQ(s->weight, Rgb(1.0f));
      }
    }
  }
}

TEST(BsdfEnergy, DielectricOverWhiteLambertKeepsAllEnergy) {
  // Smooth: exactly. Rough: what single scattering loses from the specular lobe reaches the diffuse one.
  for (const float roughness : {0.0f, 0.1f, 0.3f, 0.6f, 1.0f}) {
    for (const float degrees : {2.0f, 45.0f, 70.0f, 85.0f}) {
      const Rgb e = furnace(plastic(roughness), at_angle(degrees), Transport::kRadiance, 200000, 6);
      EXPECT_NEAR(e.x, 1.0f, 5e-3f) << roughness << ' ' << degrees;
    }
  }
}

TEST(BsdfEnergy, SheenOverWhiteLambertStaysBelowOneButClose) {
  for (const float roughness : {0.0f, 0.2f, 0.5f, 1.0f}) {
    for (const float degrees : {2.0f, 45.0f, 70.0f, 85.0f}) {
      const Rgb e =
          furnace(with_sheen(lambert(Rgb(1.0f)), roughness), at_angle(degrees), Transport::kRadiance, 200000, 6);
      EXPECT_LE(e.x, 1.004f) << roughness << ' ' << degrees;
      EXPECT_GE(e.x, 0.7f) << roughness << ' ' << degrees;
    }
  }
}

TEST(BsdfEnergy, ApproximateAlbedoIsNearTheSampledOne) {
  for (const NamedMaterial& m : all_materials()) {
    for (const float degrees : {10.0f, 50.0f, 75.0f, 150.0f}) {
      for (const Portion portion : kPortions) {
        const Vec3f wo = at_angle(degrees);
        const Rgb approximate = Bsdf(m.params, wo).albedo(portion);
        const Rgb sampled = furnace(m.params, wo, Transport::kFlux, 20000, 8, portion);
        for (int k = 0; k < 3; ++k) {
          EXPECT_NEAR(approximate[k], sampled[k], 0.15f)
              << m.name << ' ' << degrees << ' ' << static_cast<int>(portion);
        }
      }
    }
  }
}

TEST(BsdfTransport, RefractedRadianceAndFluxDifferByTheSquaredIndices) {
  for (const float degrees : {20.0f, 60.0f, 160.0f}) {
    const Vec3f wo = at_angle(degrees);
    const Bsdf bsdf(glass(0.0f), wo);
    const auto radiance = bsdf.sample(wo, 0.999f, {0.3f, 0.6f}, Transport::kRadiance);
    const auto flux = bsdf.sample(wo, 0.999f, {0.3f, 0.6f}, Transport::kFlux);
    ASSERT_TRUE(radiance && flux && radiance->refracted && flux->refracted);
    const float eta = degrees < 90.0f ? 1.5f : 1.0f / 1.5f;  // of the far side over wo's side
    EXPECT_NEAR(radiance->weight.x / flux->weight.x, 1.0f / (eta * eta), 1e-5f);
    const float sin_o = std::sqrt(1.0f - wo.z * wo.z);
    EXPECT_NEAR(std::hypot(flux->wi.x, flux->wi.y) * eta, sin_o, 1e-5f) << "Snell";
    EXPECT_LT(flux->wi.z * wo.z, 0.0f);
  }
}

TEST(BsdfTransport, FurnaceOfTiltedNormalsKeepsItsEnergy) {
  const NamedMaterial materials[] = {{"Lambert", lambert(Rgb(1.0f))}, {"plastic", plastic(0.5f)},
                                     {"mirror", metal(0.0f)},         {"glossy metal", metal(0.2f)},
                                     {"glass", glass(0.0f)},          {"sheet", sheet(0.0f)}};
  for (const NamedMaterial& m : materials) {
    for (const Transport mode : kTransports) {
      double sum = 0.0;
      constexpr int kDirections = 20000, kEach = 8;
      Random random(13);
      for (int i = 0; i < kDirections; ++i) {
        const Vec3f wo = sample_cosine_hemisphere(random.square());
        sum += furnace(tilted(m.params, 10.0f), wo, mode, kEach, static_cast<std::uint32_t>(i)).x;
      }
      const double mean = sum / kDirections;
      // Lost: (1 - cos 10 deg) / 2 of Lambert, and of mirrors what would go below the surface. Radiance that
      // enters glass is divided by eta^2.
      const double whole = m.name == "glass" && mode == Transport::kRadiance ? 0.0918 + (1.0 - 0.0918) / 2.25 : 1.0;
      EXPECT_NEAR(mean, whole, 0.04) << m.name << " mode " << static_cast<int>(mode);
    }
  }
}

TEST(BsdfTransport, SmoothLobesCarryTheCorrectionOfTheirOwnNormal) {
  SurfaceParams p = coated(lambert(Rgb(1.0f)), 0.0f);
  p.clearcoat_ns = tilted(p, 12.0f).ns;
  for (const SurfaceParams& surface : {p, tilted(metal(0.0f), 12.0f), tilted(glass(0.0f), 12.0f)}) {
    const Vec3f wo = at_angle(40.0f);
    const Vec3f n = surface.clearcoat > 0.0f ? surface.clearcoat_ns : surface.ns;
    const Bsdf bsdf(surface, wo);
    int seen = 0;
    for (int i = 0; i < 200; ++i) {
      const float u = (static_cast<float>(i) + 0.5f) / 200.0f;
      const auto radiance = bsdf.sample(wo, u, {0.4f, 0.7f}, Transport::kRadiance);
      const auto flux = bsdf.sample(wo, u, {0.4f, 0.7f}, Transport::kFlux);
      if (!flux || !flux->delta) continue;
      const Vec3f& wi = flux->wi;
      const float veach = std::abs(dot(wo, n) * wi.z / (wo.z * dot(wi, n)));
      const float scale = flux->transmitted ? 1.5f * 1.5f : 1.0f;
      EXPECT_NEAR(flux->weight.x, radiance->weight.x * veach * scale, 1e-5f);
      ++seen;
    }
    EXPECT_GT(seen, 5);
  }
}

TEST(BsdfTransport, NoLightLeaksWhereTheNormalsDisagree) {
  Random random(14);
  for (const NamedMaterial& m : all_materials()) {
    const SurfaceParams p = tilted(m.params, 30.0f);
    for (int i = 0; i < 2000; ++i) {
      const Vec3f wo = random.sphere(), wi = random.sphere();
      const Bsdf bsdf(p, wo);
      ASSERT_GT(dot(wo, bsdf.ns()), 0.0f);
      ASSERT_GT(dot(wo, bsdf.ng()), 0.0f);
      if ((dot(wi, bsdf.ns()) > 0.0f) == (dot(wi, bsdf.ng()) > 0.0f)) continue;
      ASSERT_TRUE(is_zero(bsdf.eval(wo, wi, Transport::kRadiance))) << m.name;
      ASSERT_EQ(bsdf.pdf(wo, wi, Transport::kRadiance), 0.0f) << m.name;
    }
  }
}

TEST(Fresnel, MatchesClosedForms) {
  EXPECT_NEAR(fresnel_dielectric(1.0f, 1.5f), 0.04f, 1e-7f);
  EXPECT_NEAR(fresnel_dielectric(1.0f, 1.0f / 1.5f), 0.04f, 1e-7f);
  EXPECT_EQ(fresnel_dielectric(0.5f, 1.0f), 0.0f);
  EXPECT_NEAR(fresnel_dielectric(0.0f, 1.5f), 1.0f, 1e-6f);
  // At Brewster's angle, tan = n, only perpendicular light is reflected: ((n^2-1)/(n^2+1))^2 / 2.
  EXPECT_NEAR(fresnel_dielectric(1.0f / std::sqrt(1.0f + 2.25f), 1.5f), 0.5f * 0.1479290f, 1e-6f);
  const float critical = std::sqrt(1.0f - 1.0f / 2.25f);
  EXPECT_EQ(fresnel_dielectric(critical - 1e-4f, 1.0f / 1.5f), 1.0f);
  EXPECT_LT(fresnel_dielectric(critical + 1e-3f, 1.0f / 1.5f), 1.0f);
  EXPECT_NEAR(dielectric_f0(1.5f), 0.04f, 1e-7f);
  EXPECT_EQ(dielectric_f0(kInfinity), 1.0f);
}

TEST(Fresnel, SmoothGlassReflectsWithTheProbabilityF) {
  for (const float degrees : {0.0f, 40.0f, 70.0f, 85.0f}) {
    const Vec3f wo = at_angle(degrees);
    const Bsdf bsdf(glass(0.0f), wo);
    const float f = fresnel_dielectric(std::cos(degrees * kPi / 180.0f), 1.5f);
    const auto below = bsdf.sample(wo, f - 1e-4f, {0.5f, 0.5f}, Transport::kFlux);
    const auto above = bsdf.sample(wo, f + 1e-4f, {0.5f, 0.5f}, Transport::kFlux);
    ASSERT_TRUE(below && above);
    EXPECT_FALSE(below->transmitted);
    EXPECT_TRUE(above->transmitted && above->refracted);
  }
}

TEST(Fresnel, ThinSheetTransmitsLikeASlabWithAllInternalReflections) {
  const float expected[][2] = {
      {0.0f, 0.923077f}, {30.0f, 0.92027f}, {45.0f, 0.90433f}, {60.0f, 0.83623f}, {75.0f, 0.59609f}};
  for (const auto& [degrees, transmitted] : expected) {
    const Vec3f wo = at_angle(degrees);
    const Bsdf bsdf(sheet(0.0f), wo);
    double sum = 0.0;
    constexpr int kSteps = 200000;
    for (int i = 0; i < kSteps; ++i) {
      const auto s = bsdf.sample(wo, (static_cast<float>(i) + 0.5f) / kSteps, {0.5f, 0.5f}, Transport::kRadiance);
      ASSERT_TRUE(s);
      if (!s->transmitted) continue;
      ASSERT_EQ(s->wi, -wo);
      ASSERT_FALSE(s->refracted);
      sum += s->weight.x;
    }
    EXPECT_NEAR(sum / kSteps, transmitted, 2e-5) << degrees;
  }
}

TEST(Fresnel, ConductorReflectsItsBaseColourHeadOnAndWhiteAtTheHorizon) {
  const Rgb gold(1.0f, 0.7f, 0.3f);
  const auto head_on = Bsdf(metal(0.0f, gold), {0, 0, 1}).sample({0, 0, 1}, 0.5f, {0.5f, 0.5f}, Transport::kFlux);
  EXPECT_NEAR(head_on->weight.z, 0.3f, 1e-6f);
  const Vec3f low = at_angle(89.9f);
  EXPECT_GT(Bsdf(metal(0.0f, gold), low).sample(low, 0.5f, {0.5f, 0.5f}, Transport::kFlux)->weight.z, 0.99f);
}

TEST(BsdfModel, SpecularZeroIsExactlyLambert) {
  const Rgb base(0.2f, 0.5f, 0.8f);
  for (const float roughness : {0.0f, 0.5f, 1.0f}) {
    SurfaceParams p = lambert(base);
    p.roughness = roughness;
    const Vec3f wo = at_angle(65.0f);
    const Bsdf bsdf(p, wo);
    EXPECT_TRUE(bsdf.gather_is_lambert());
    EXPECT_FALSE(bsdf.has_delta());
    EXPECT_EQ(bsdf.lambert_f(), base * kInvPi);
    for (const float degrees : {0.0f, 60.0f, 89.0f}) {
      EXPECT_EQ(bsdf.eval(wo, at_angle(degrees), Transport::kRadiance), base * kInvPi);
    }
    EXPECT_TRUE(is_zero(bsdf.eval(wo, at_angle(100.0f), Transport::kRadiance)));
    EXPECT_EQ(bsdf.albedo(Portion::kGather), base);
    EXPECT_EQ(bsdf.albedo(Portion::kFollow), Rgb(0.0f));
  }
}

TEST(BsdfModel, EqualIndicesPassStraightOn) {
  SurfaceParams p = glass(0.3f, 1.33f);
  p.eta_outside = 1.33f;
  for (const float degrees : {30.0f, 150.0f}) {
    const Vec3f wo = at_angle(degrees);
    const Bsdf bsdf(p, wo);
    EXPECT_TRUE(bsdf.is_delta_only());
    const auto s = bsdf.sample(wo, 0.1f, {0.2f, 0.9f}, Transport::kRadiance);
    ASSERT_TRUE(s && s->transmitted && s->refracted);
    EXPECT_EQ(s->wi, -wo);
    EXPECT_EQ(s->weight, Rgb(1.0f));
  }
}

TEST(BsdfModel, BaseColourTintsTransmissionOncePerCrossing) {
  SurfaceParams p = glass(0.0f);
  p.base_color = {0.5f, 0.25f, 1.0f};
  const Vec3f wo = at_angle(20.0f);
  double sum[3] = {0, 0, 0};
  constexpr int kSteps = 20000;
  for (int i = 0; i < kSteps; ++i) {
    const auto s = Bsdf(p, wo).sample(wo, (static_cast<float>(i) + 0.5f) / kSteps, {0.5f, 0.5f}, Transport::kFlux);
    ASSERT_TRUE(s);
    for (int k = 0; k < 3; ++k) sum[k] += s->transmitted ? s->weight[k] / kSteps : 0.0;
  }
  const float passed = 1.0f - fresnel_dielectric(wo.z, 1.5f);
  EXPECT_NEAR(sum[0], 0.5f * passed, 1e-4);
  EXPECT_NEAR(sum[1], 0.25f * passed, 1e-4);
  EXPECT_NEAR(sum[2], passed, 1e-4);
}

TEST(BsdfModel, UnlitScattersNothing) {
  SurfaceParams p = plastic(0.3f);
  p.scatters = false;
  const Bsdf bsdf(p, at_angle(10.0f));
  EXPECT_TRUE(bsdf.is_black());
  EXPECT_FALSE(bsdf.sample(at_angle(10.0f), 0.5f, {0.5f, 0.5f}, Transport::kFlux));
  EXPECT_TRUE(is_zero(bsdf.eval(at_angle(10.0f), at_angle(10.0f), Transport::kFlux)));
}

TEST(BsdfModel, SpecularFactorZeroMakesSmoothGlassInvisibleButForRefraction) {
  SurfaceParams p = glass(0.0f);
  p.specular = 0.0f;
  const Vec3f wo = at_angle(60.0f);
  const auto s = Bsdf(p, wo).sample(wo, 1e-6f, {0.5f, 0.5f}, Transport::kFlux);
  ASSERT_TRUE(s);
  EXPECT_TRUE(s->refracted);
  EXPECT_EQ(s->weight, Rgb(1.0f));
  // From inside beyond the critical angle nothing can leave.
  const Vec3f inside = at_angle(120.0f);
  const auto total = Bsdf(p, inside).sample(inside, 0.999f, {0.5f, 0.5f}, Transport::kFlux);
  ASSERT_TRUE(total);
  EXPECT_FALSE(total->transmitted);
  EXPECT_EQ(total->weight, Rgb(1.0f));
}

TEST(AlbedoTable, GgxOfAMirrorAndOfARoughSurface) {
  const GgxAlbedo& e = GgxAlbedo::get();
  EXPECT_NEAR(e.f0.at(0.5f, 0.0f) + e.f90.at(0.5f, 0.0f), 1.0f, 1e-5f);
  EXPECT_NEAR(e.f90.at(0.25f, 0.0f), std::pow(0.75f, 5.0f), 2e-3f);
  // The mean of 1 - single-scattering albedo at alpha = 1: Heitz's height-correlated GGX keeps a little over
  // half.
  const float mean = e.f0.mean(1.0f) + e.f90.mean(1.0f);
  EXPECT_GT(mean, 0.4f);
  EXPECT_LT(mean, 0.7f);
  const float sheen = sheen_albedo().mean(0.5f);
  EXPECT_GT(sheen, 0.05f);
  EXPECT_LT(sheen, 0.9f);
}

}  // namespace
}  // namespace pf::test
