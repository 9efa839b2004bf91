// Whatever comes in, what comes out is finite, not negative, and unit where it is a direction.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/unit/bsdf/materials.h"

namespace pf::test {
namespace {

/// Mostly within [0,1], often at its ends, rarely absurd.
float any_factor(Random& random, bool absurd) {
  const float choice = random.uniform();
  if (choice < 0.2f) return 0.0f;
  if (choice < 0.4f) return 1.0f;
  if (choice < 0.5f) return std::pow(10.0f, -8.0f * random.uniform());
  if (absurd && choice < 0.52f) return std::numeric_limits<float>::quiet_NaN();
  if (absurd && choice < 0.54f) return kInfinity;
  if (absurd && choice < 0.58f) return -random.uniform();
  if (absurd && choice < 0.62f) return 1e30f * random.uniform();
  return random.uniform();
}

Rgb any_color(Random& random, bool absurd) {
  const float x = any_factor(random, absurd), y = any_factor(random, absurd);
  return {x, y, any_factor(random, absurd)};
}

Vec3f any_direction(Random& random) {
  Vec3f v = random.sphere();
  const float choice = random.uniform();
  if (choice < 0.2f) v.z *= std::pow(10.0f, -7.0f * random.uniform());
  if (choice > 0.9f) v = {0, 0, choice > 0.95f ? 1.0f : -1.0f};
  if (choice > 0.5f && choice < 0.55f) v = normalize(Vec3f(1e-4f * v.x, 1e-4f * v.y, v.z));
  return normalize(v);
}

Vec3f any_normal(Random& random, const Vec3f& ng, bool absurd) {
  const float choice = random.uniform();
  if (choice < 0.4f) return ng;
  if (absurd && choice < 0.42f) return {0, 0, 0};
  if (absurd && choice < 0.44f) return Vec3f(std::numeric_limits<float>::quiet_NaN());
  if (choice < 0.6f) return random.sphere();
  return normalize(ng + random.sphere() * (0.7f * random.uniform()));
}

SurfaceParams any_surface(Random& random, bool absurd) {
  SurfaceParams p;
  if (random.uniform() < 0.3f) p.ng = random.sphere();
  if (absurd && random.uniform() < 0.02f) p.ng = {0, 0, 0};
  p.ns = any_normal(random, p.ng, absurd);
  p.clearcoat_ns = any_normal(random, p.ng, absurd);
  p.base_color = any_color(random, absurd);
  p.metallic = any_factor(random, absurd);
  p.roughness = any_factor(random, absurd);
  p.ior = random.uniform() < 0.2f ? any_factor(random, absurd) : 1.0f + 2.0f * any_factor(random, absurd);
  p.specular = any_factor(random, absurd);
  p.specular_color = any_color(random, absurd) * 2.0f;
  p.transmission = any_factor(random, absurd);
  p.thin_walled = random.uniform() < 0.5f;
  p.eta_outside = random.uniform() < 0.7f ? 1.0f : 1.0f + any_factor(random, absurd);
  p.clearcoat = any_factor(random, absurd);
  p.clearcoat_roughness = any_factor(random, absurd);
  p.sheen_color = any_color(random, absurd);
  p.sheen_roughness = any_factor(random, absurd);
  return p;
}

bool sound(const Rgb& c) { return is_finite(c) && c.x >= 0.0f && c.y >= 0.0f && c.z >= 0.0f; }

void draw_everything(bool absurd, int draws, std::uint32_t seed) {
  Random random(seed);
  for (int i = 0; i < draws; ++i) {
    const SurfaceParams p = any_surface(random, absurd);
    Vec3f wo = any_direction(random);
    if (absurd && random.uniform() < 0.01f) wo = Vec3f(0.0f);
    const Bsdf bsdf(p, wo);
    const Portion portion = kPortions[i % 3];
    const Transport mode = kTransports[i / 3 % 2];
    const float u = random.uniform() < 0.05f ? kOneMinusEpsilon : random.uniform();
    Vec2f v = random.square();
    if (random.uniform() < 0.05f) v.x = random.uniform() < 0.5f ? 0.0f : kOneMinusEpsilon;
    const Rgb albedo = bsdf.albedo(portion);
    ASSERT_TRUE(sound(albedo) && max_component(albedo) <= 1.0f) << i << ' ' << albedo;
    ASSERT_NEAR(length(bsdf.ns()), 1.0f, 1e-2f) << i;
    ASSERT_NEAR(length(bsdf.ng()), 1.0f, 1e-2f) << i;
    if (const auto s = bsdf.sample(wo, u, v, mode, portion)) {
      ASSERT_TRUE(sound(s->weight)) << i << ' ' << s->weight;
      ASSERT_TRUE(std::isfinite(s->pdf_w) && (s->delta ? s->pdf_w == 0.0f : s->pdf_w > 0.0f)) << i << ' ' << s->pdf_w;
      ASSERT_NEAR(length(s->wi), 1.0f, 1e-3f) << i;
      ASSERT_EQ(s->transmitted, dot(s->wi, bsdf.ng()) < 0.0f) << i;
      ASSERT_TRUE(s->specularity >= 0.0f && s->specularity <= 1.0f) << i;
      ASSERT_FALSE(bsdf.is_black()) << i;
    }
    const Vec3f wi = any_direction(random);
    const Rgb f = bsdf.eval(wo, wi, mode, portion);
    const float pdf = bsdf.pdf(wo, wi, mode, portion);
    ASSERT_TRUE(sound(f)) << i << ' ' << f;
    ASSERT_TRUE(std::isfinite(pdf) && pdf >= 0.0f) << i << ' ' << pdf;
    // Whatever can scatter can be sampled.
    ASSERT_TRUE(pdf > 0.0f || max_component(f) == 0.0f) << i << ' ' << f;
  }
}

TEST(BsdfRobustness, ValidMaterialsGiveFiniteResultsInAMillionDraws) { draw_everything(false, 1000000, 1); }
TEST(BsdfRobustness, AbsurdParametersGiveFiniteResults) { draw_everything(true, 300000, 2); }

TEST(BsdfRobustness, GrazingMirrorsAndGlassStayFinite) {
  for (const float height : {1e-8f, 1e-6f, 1e-4f, 1e-2f}) {
    for (const float side : {1.0f, -1.0f}) {
      const Vec3f wo = normalize(Vec3f(1.0f, 0.0f, side * height));
      for (const NamedMaterial& m : all_materials()) {
        for (int i = 0; i < 64; ++i) {
          const float u = (static_cast<float>(i) + 0.5f) / 64.0f;
          const auto s = Bsdf(m.params, wo).sample(wo, u, {u, 1.0f - u}, Transport::kFlux);
          if (s) {
            ASSERT_TRUE(sound(s->weight)) << m.name << ' ' << height;
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace pf::test
