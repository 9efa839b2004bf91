// The short cuts that photons take at the commonest surfaces give what Bsdf gives, number for number.
#include <gtest/gtest.h>

#include <array>
#include <optional>

#include "tests/unit/bsdf/materials.h"
#include "worker/bsdf/lambert_lanes.h"
#include "worker/bsdf/smooth.h"
#include "worker/bsdf/smooth_lanes.h"

namespace pf::test {
namespace {

constexpr int kConfigurations = 100000;

/// Often at the ends of [0,1].
float any_portion(Random& random) {
  const float choice = random.uniform();
  return choice < 0.25f ? 0.0f : (choice < 0.5f ? 1.0f : random.uniform());
}
Rgb any_color(Random& random) {
  const float x = any_portion(random), y = any_portion(random);
  return {x, y, any_portion(random)};
}

/// Normals and a direction to look from, now and then nearly edge-on, with shading normals of any tilt.
Vec3f place(Random& random, SurfaceParams& p) {
  p.ng = random.sphere();
  const float choice = random.uniform();
  p.ns = choice < 0.3f ? p.ng : (choice < 0.4f ? random.sphere() : normalize(p.ng + random.sphere() * 0.5f));
  const Vec3f wo = random.sphere();
  if (random.uniform() > 0.1f) return wo;
  return normalize(wo - p.ng * (dot(wo, p.ng) * (1.0f - 1e-4f * random.uniform())));
}

void expect_same(const std::optional<BsdfSample>& exact, const Vec3f& wi, const Rgb& weight) {
  ASSERT_TRUE(exact);
  EXPECT_EQ(exact->wi, wi);
  EXPECT_EQ(exact->weight, weight);
}

TEST(FastPaths, EightLambertSurfacesAreTheirBsdfsNumberForNumber) {
  Random random(11);
  int drawn = 0;
  for (int k = 0; k < kConfigurations / kLanes; ++k) {
    std::array<SurfaceParams, kLanes> params;
    std::array<Vec3f, kLanes> wo;
    Vec3x8 ng{}, ns{}, from{}, albedo{};
    Vec2x8 u{};
    for (std::size_t i = 0; i < kLanes; ++i) {
      params[i] = lambert(any_color(random));
      wo[i] = place(random, params[i]);
      ng.set(i, params[i].ng), ns.set(i, params[i].ns), from.set(i, wo[i]);
      ASSERT_TRUE(plain_lambert_albedo(params[i]));
      albedo.set(i, *plain_lambert_albedo(params[i]));
      u.x[i] = random.uniform(), u.y[i] = random.uniform();
    }
    const LambertLanes surfaces(ng, ns, from);
    const LambertLanes::Sample fast = surfaces.sample_flux(albedo, u);
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Bsdf bsdf(params[i], wo[i]);
      ASSERT_EQ(bsdf.is_black(), surfaces.seen()[i] == 0 || is_zero(albedo[i]));
      if (bsdf.is_black()) continue;
      EXPECT_EQ(bsdf.ng(), surfaces.ng()[i]);
      EXPECT_EQ(dot(wo[i], bsdf.ng()), surfaces.wo_ng()[i]);
      EXPECT_EQ(dot(wo[i], bsdf.ns()), surfaces.wo_ns()[i]);
      const auto exact = bsdf.sample(wo[i], random.uniform(), {u.x[i], u.y[i]}, Transport::kFlux);
      ASSERT_EQ(exact.has_value(), fast.valid[i] != 0);
      if (!exact) continue;
      expect_same(exact, fast.wi[i], fast.weight[i]);
      ++drawn;
    }
  }
  EXPECT_GT(drawn, kConfigurations / 2);
}

/// Any material of which nothing is matte.
SurfaceParams any_smooth(Random& random) {
  SurfaceParams p;
  p.base_color = any_color(random);
  p.metallic = any_portion(random);
  p.transmission = p.metallic == 1.0f ? any_portion(random) : 1.0f;
  p.roughness = random.uniform() < 0.7f ? 0.0f : 0.03f * random.uniform();
  p.thin_walled = random.uniform() < 0.4f;
  p.ior = random.uniform() < 0.05f ? 0.0f : 1.0f + any_portion(random);
  p.eta_outside = random.uniform() < 0.6f ? 1.0f : 1.0f + random.uniform();
  if (random.uniform() < 0.3f) p.specular = any_portion(random);
  if (random.uniform() < 0.3f) p.specular_color = any_color(random) * 2.0f;
  return p;
}

TEST(FastPaths, SmoothSurfacesAreTheirBsdfsNumberForNumber) {
  Random random(12);
  int reflected = 0, refracted = 0, empty = 0;
  for (int k = 0; k < kConfigurations / kLanes; ++k) {
    std::array<SurfaceParams, kLanes> params;
    std::array<Vec3f, kLanes> wo;
    std::array<std::optional<Interface>, kLanes> rooms;
    std::array<std::optional<SmoothMaterial>, kLanes> materials;
    std::array<const Interface*, kLanes> boundaries{};
    Vec3x8 ng, ns, towards;
    Float8 u_lobe{};
    for (std::size_t i = 0; i < kLanes; ++i) {
      do {  // nothing mirrors between equal indices
        params[i] = any_smooth(random);
        wo[i] = place(random, params[i]);
        materials[i] = SmoothMaterial::of(params[i]);
        ASSERT_TRUE(materials[i]);
        boundaries[i] = materials[i]->boundary(params[i].eta_outside, dot(wo[i], params[i].ng) > 0.0f, rooms[i]);
      } while (boundaries[i] == nullptr);
      ng.set(i, params[i].ng);
      ns.set(i, params[i].ns);
      towards.set(i, wo[i]);
      u_lobe[i] = random.uniform();
    }
    const InterfaceLanes boundary(boundaries);
    const SmoothLanes::Sample fast = SmoothLanes(boundary, ng, ns, towards).sample_flux(u_lobe);
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Bsdf bsdf(params[i], wo[i]);
      EXPECT_TRUE(bsdf.is_black() || bsdf.is_delta_only());
      const auto exact = bsdf.sample(wo[i], u_lobe[i], {random.uniform(), random.uniform()}, Transport::kFlux);
      ASSERT_EQ(exact.has_value(), fast.valid[i] != 0);
      if (!exact) {
        ++empty;
        continue;
      }
      expect_same(exact, fast.wi[i], fast.weight[i]);
      EXPECT_EQ(exact->refracted, fast.refracted[i] != 0);
      EXPECT_EQ(exact->specularity, 1.0f);
      EXPECT_TRUE(exact->delta);
      ++(exact->refracted ? refracted : reflected);
    }
  }
  EXPECT_GT(reflected, kConfigurations / 4);
  EXPECT_GT(refracted, kConfigurations / 10);
  EXPECT_GT(empty, kConfigurations / 1000);
}

TEST(FastPaths, OnlyWhatIsNothingButSmoothIsASmoothMaterial) {
  for (const auto& [name, params] : all_materials()) {
    const auto smooth = SmoothMaterial::of(params);
    const Bsdf bsdf(params, {0.0f, 0.0f, 1.0f});
    const bool coated = params.clearcoat > 0.0f;
    const bool equal = params.transmission > 0.0f && std::abs(params.ior - 1.0f) < 1e-3f;
    EXPECT_EQ(smooth.has_value(), bsdf.is_delta_only() && !coated) << name;
    if (!smooth) continue;
    std::optional<Interface> room;
    EXPECT_EQ(smooth->boundary(1.0f, true, room) == nullptr, equal) << name;
  }
}

}  // namespace
}  // namespace pf::test
