#include "worker/scene/lights.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/unit/scene/lights_fixtures.h"
#include "worker/scene/spherical_shapes.h"

namespace pf {
namespace {

/// Irradiance below a polygon that lies above the horizon [Arvo's thesis, eq. 3.1 to 3.3], radiance 1.
double polygon_irradiance(const Vec3f& p, const Vec3f& n, const std::vector<Vec3f>& corners) {
  double sum = 0.0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Vec3d a = (Vec3d(corners[i]) - Vec3d(p)).normalized();
    const Vec3d b = (Vec3d(corners[(i + 1) % corners.size()]) - Vec3d(p)).normalized();
    sum += std::acos(a.dot(b)) * a.cross(b).normalized().dot(Vec3d(n));
  }
  return std::abs(sum) / 2.0;
}

TEST(Lights, SquareLightGivesTheClosedFormBelowItsCentre) {
  // Side 1 at height 1, facing down: E = 0.752275 L.
  const Lights lights = make(quad(Vec3f(-0.5f, 1, -0.5f), Vec3f(1, 0, 0), Vec3f(0, 0, 1), Rgb(10.0f)));
  ASSERT_EQ(lights.area_lights().size(), 1u);
  EXPECT_TRUE(lights.area_lights()[0].is_rectangle());
  EXPECT_LT(lights.area_lights()[0].ng().y, 0.0f);
  expect_irradiance(lights, Vec3f(0, 0, 0), kUp, 7.52275);
  // Sampled by solid angle, only the receiver's cosine varies.
  EXPECT_LT(irradiance(lights, Vec3f(0, 0, 0), kUp, 10000).deviation * 100.0, 0.12 * 7.52275);
}

TEST(Lights, RandomPolygonsGiveLambertsIrradiance) {
  PathRng rng(5, Stream::kTest, 0, 0);
  const auto in_box = [&](float low, float high) {
    return Vec3f(4.0f * rng.next1() - 2.0f, low + (high - low) * rng.next1(), 4.0f * rng.next1() - 2.0f);
  };
  for (int i = 0; i < 12; ++i) {
    const float distance = i % 3 == 0 ? 0.05f : (i % 3 == 1 ? 1.0f : 20.0f);  // solid angles of every size
    std::vector<Vec3f> corners = {in_box(distance, 1.5f * distance), in_box(distance, 1.5f * distance),
                                  in_box(distance, 1.5f * distance)};
    std::vector<EmissiveTriangle> triangles;
    if (i % 2 == 0) {
      triangles = {triangle(corners[0], corners[1], corners[2], Rgb(1.0f), true)};
    } else {
      triangles = quad(corners[0], corners[1] - corners[0], corners[2] - corners[0], Rgb(1.0f), true);
      corners.insert(corners.begin() + 2, corners[1] + (corners[2] - corners[0]));
      if (corners[2].y <= 0.0f) continue;
    }
    const Lights lights = make(triangles);
    ASSERT_EQ(lights.area_lights().size(), 1u);
    expect_irradiance(lights, Vec3f(0, 0, 0), kUp, polygon_irradiance(Vec3f(0, 0, 0), kUp, corners));
  }
}

TEST(Lights, DiscAndSphereOfManyTrianglesGiveTheirClosedForms) {
  constexpr int kSides = 256;
  std::vector<EmissiveTriangle> disc;
  for (int i = 0; i < kSides; ++i) {
    const auto at = [](int k) {
      const float phi = 2.0f * kPi * static_cast<float>(k % kSides) / kSides;
      return Vec3f(std::cos(phi), 2.0f, std::sin(phi));
    };
    disc.push_back(triangle(Vec3f(0, 2, 0), at(i), at(i + 1), Rgb(3.0f)));
  }
  ASSERT_LT(disc[0].ng.y, 0.0f);
  const double polygon = 0.5 * kSides * std::sin(2.0 * M_PI / kSides) / M_PI;  // area against the disc's
  expect_irradiance(make(disc), Vec3f(0, 0, 0), kUp, 3.0 * M_PI / 5.0 * polygon, 100000);

  std::vector<EmissiveTriangle> sphere;
  constexpr int kRings = 32;
  const auto at = [](int ring, int k) {
    const float theta = kPi * static_cast<float>(ring) / kRings;
    const float phi = 2.0f * kPi * static_cast<float>(k % (2 * kRings)) / (2 * kRings);
    return Vec3f(std::sin(theta) * std::cos(phi), 3.0f + std::cos(theta), std::sin(theta) * std::sin(phi));
  };
  for (int ring = 0; ring < kRings; ++ring) {
    for (int k = 0; k < 2 * kRings; ++k) {
      if (ring > 0) sphere.push_back(triangle(at(ring, k), at(ring, k + 1), at(ring + 1, k), Rgb(3.0f)));
      if (ring + 1 < kRings)
        sphere.push_back(triangle(at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k), Rgb(3.0f)));
    }
  }
  const Estimate e = irradiance(make(sphere), Vec3f(0, 0, 0), kUp, 200000);
  EXPECT_NEAR(e.mean, 3.0 * M_PI / 9.0, 5.0 * e.deviation + 0.01);  // the polyhedron is a little smaller
}

TEST(Lights, PointSpotAndDirectionalGiveTheirClosedForms) {
  PunctualLight point;
  point.intensity = Rgb(8.0f);
  point.position = Vec3f(1, 2, 0);
  expect_irradiance(make({}, {point}), Vec3f(0, 0, 0), kUp, 8.0 * (2.0 / std::sqrt(5.0)) / 5.0, 10);

  PunctualLight spot = point;
  spot.kind = PunctualKind::kSpot;
  spot.position = Vec3f(0, 2, 0);
  spot.direction = Vec3f(0, -1, 0);
  spot.cos_inner = std::cos(0.2f);
  spot.cos_outer = std::cos(0.6f);
  const Lights lights = make({}, {spot});
  expect_irradiance(lights, Vec3f(0, 0, 0), kUp, 2.0, 10);
  const double angle = 0.4, cosine = std::cos(angle);
  const double ramp = (cosine - std::cos(0.6)) / (std::cos(0.2) - std::cos(0.6));
  expect_irradiance(lights, Vec3f(2.0f * std::tan(0.4f), 0, 0), kUp,
                    8.0 * ramp * ramp * cosine / (4.0 / cosine / cosine), 10);
  EXPECT_FALSE(lights.sample(Vec3f(2.0f, 0, 0), kUp, false, 0.5f, Vec2f(0.5f, 0.5f)));
  EXPECT_FALSE(lights.sample(Vec3f(0, 3, 0), -kUp, false, 0.5f, Vec2f(0.5f, 0.5f)));

  PunctualLight sun;
  sun.kind = PunctualKind::kDirectional;
  sun.intensity = Rgb(5.0f);
  sun.direction = normalize(Vec3f(1, -1, 0));
  expect_irradiance(make({}, {sun}), Vec3f(0, 0, 0), kUp, 5.0 / std::sqrt(2.0), 10);
  EXPECT_FALSE(make({}, {sun}).sample(Vec3f(0, 0, 0), -kUp, false, 0.5f, Vec2f(0.5f, 0.5f)));
  EXPECT_TRUE(make({}, {sun}).sample(Vec3f(0, 0, 0), -kUp, true, 0.5f, Vec2f(0.5f, 0.5f)));
  EXPECT_TRUE(make({}, {sun}).sample(Vec3f(0, 0, 0), kUp, false, 0.5f, Vec2f(0.5f, 0.5f))->sample.delta);
}

TEST(Lights, DensityOfEverySampleIsWhatPdfSays) {
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    const RandomScene scene(seed);
    const Lights lights = scene.lights();
    PathRng rng(seed, Stream::kTest, 2, 0);
    for (int i = 0; i < 500; ++i) {
      const Vec3f p = sample_sphere(rng.next2()) * (4.0f * rng.next1()), n = sample_sphere(rng.next2());
      const bool transmissive = rng.next1() < 0.5f;
      const float pick = rng.next1();
      const auto s = lights.sample(p, n, transmissive, pick, rng.next2());
      if (!s || s->sample.delta) continue;
      if (s->triangle < 0) {
        EXPECT_NEAR(lights.pdf_w_environment(p, n, transmissive, s->sample.wi) / s->sample.pdf_w, 1.0f, 1e-5f);
        continue;
      }
      const EmissiveTriangle& t = lights.triangle(static_cast<std::uint32_t>(s->triangle));
      const Vec2f b = s->barycentric;
      EXPECT_GE(std::min({b.x, b.y, 1.0f - b.x - b.y}), -1e-5f);
      const Vec3f q = t.p0 * (1.0f - b.x - b.y) + t.p1 * b.x + t.p2 * b.y;
      EXPECT_LT(length(p + s->sample.wi * s->sample.distance - q), 1e-5f);
      EXPECT_EQ(s->sample.radiance, t.radiance);
      if (std::abs(dot(t.ng, s->sample.wi)) < 0.02f) continue;  // the cosine loses its digits
      const float pdf = lights.pdf_w(p, n, transmissive, static_cast<std::uint32_t>(s->triangle), q);
      EXPECT_NEAR(pdf / s->sample.pdf_w, 1.0f, 1e-3f) << "seed " << seed << " sample " << i;
    }
  }
}

/// Where the ray from p along d meets the triangle: distance, or a negative number.
float hit(const EmissiveTriangle& t, const Vec3f& p, const Vec3f& d) {
  const Vec3f e1 = t.p1 - t.p0, e2 = t.p2 - t.p0, h = cross(d, e2), s = p - t.p0, q = cross(s, e1);
  const float f = 1.0f / dot(e1, h);
  const float u = f * dot(s, h), v = f * dot(d, q);
  return u < 0.0f || v < 0.0f || u + v > 1.0f ? -1.0f : f * dot(e2, q);
}

TEST(Lights, DensityIntegratesToTheShareOfSamplesThatHit) {
  for (std::uint32_t seed = 0; seed < 6; ++seed) {
    const RandomScene scene(seed, false, true, 6);
    const Lights lights = scene.lights();
    PathRng place(seed, Stream::kTest, 3, 0);
    const Vec3f p = sample_sphere(place.next2()) * 3.0f, n = sample_sphere(place.next2());
    const Estimate found = estimate(40000, [&](PathRng& rng) {
      const float pick = rng.next1();
      return lights.sample(p, n, false, pick, rng.next2()) ? 1.0 : 0.0;
    });
    const Estimate integral = estimate(100000, [&](PathRng& rng) {
      const Vec3f d = sample_sphere(rng.next2());
      float sum = lights.pdf_w_environment(p, n, false, d);
      for (std::uint32_t i = 0; i < lights.triangle_count(); ++i) {
        const float t = hit(lights.triangle(i), p, d);
        if (t > 0.0f) sum += lights.pdf_w(p, n, false, i, p + d * t);
      }
      return 4.0 * M_PI * static_cast<double>(sum);
    });
    EXPECT_NEAR(found.mean, integral.mean, 4.5 * std::hypot(found.deviation, integral.deviation)) << "seed " << seed;
  }
}

TEST(Lights, LightSamplingAndDirectionSamplingAgreeAndSoDoTheirMixtures) {
  for (std::uint32_t seed = 0; seed < 6; ++seed) {
    const RandomScene scene(seed, false, true, 6);
    const Lights lights = scene.lights();
    PathRng place(seed, Stream::kTest, 4, 0);
    const Vec3f p = sample_sphere(place.next2()) * 3.0f, n = sample_sphere(place.next2());
    // Light that arrives along d, nothing occluding anything, weighted by w(light pdf, direction pdf).
    const auto by_direction = [&](PathRng& rng, bool mis) {
      const Vec3f d = sample_sphere(rng.next2());
      const float cosine = dot(n, d), pdf = 0.25f * kInvPi;
      if (cosine <= 0.0f) return 0.0;
      const auto weight = [&](float light_pdf) { return mis ? power_heuristic(pdf, light_pdf) : 1.0f; };
      float sum = average(scene.environment.radiance(d)) * weight(lights.pdf_w_environment(p, n, false, d));
      for (std::uint32_t i = 0; i < lights.triangle_count(); ++i) {
        const EmissiveTriangle& t = lights.triangle(i);
        const float distance = hit(t, p, d);
        if (distance <= 0.0f || (!t.two_sided && dot(t.ng, d) >= 0.0f)) continue;
        sum += average(t.radiance) * weight(lights.pdf_w(p, n, false, i, p + d * distance));
      }
      return static_cast<double>(sum * cosine / pdf);
    };
    const auto by_light = [&](PathRng& rng, bool mis) {
      const float pick = rng.next1();
      const auto s = lights.sample(p, n, false, pick, rng.next2());
      if (!s) return 0.0;
      const float weight = mis ? power_heuristic(s->sample.pdf_w, 0.25f * kInvPi) : 1.0f;
      return static_cast<double>(average(s->sample.radiance) * dot(n, s->sample.wi) * weight / s->sample.pdf_w);
    };
    const Estimate direction = estimate(60000, [&](PathRng& rng) { return by_direction(rng, false); });
    const Estimate light = estimate(60000, [&](PathRng& rng) { return by_light(rng, false); });
    const Estimate both = estimate(60000, [&](PathRng& rng) {
      const double first = by_direction(rng, true);
      return first + by_light(rng, true);
    });
    EXPECT_NEAR(direction.mean, light.mean, 4.5 * std::hypot(direction.deviation, light.deviation)) << "seed " << seed;
    EXPECT_NEAR(both.mean, light.mean, 4.5 * std::hypot(both.deviation, light.deviation)) << "seed " << seed;
  }
}

TEST(Lights, OneSidedEmittersAreNeverSampledFromBehind) {
  const auto front = quad(Vec3f(-1, 1, -1), Vec3f(2, 0, 0), Vec3f(0, 0, 2), Rgb(1.0f));  // faces down
  const auto both = quad(Vec3f(-1, 1, -1), Vec3f(2, 0, 0), Vec3f(0, 0, 2), Rgb(1.0f), true);
  const Vec3f below(0, 0, 0), above(0, 2, 0);
  const Vec2f u(0.3f, 0.6f);
  EXPECT_TRUE(make(front).sample(below, kUp, false, 0.5f, u));
  EXPECT_FALSE(make(front).sample(above, -kUp, false, 0.5f, u));
  EXPECT_FALSE(make(front).sample(below, -kUp, false, 0.5f, u));
  EXPECT_TRUE(make(front).sample(below, -kUp, true, 0.5f, u));
  EXPECT_TRUE(make(both).sample(above, -kUp, false, 0.5f, u));
  EXPECT_EQ(make(front).pdf_w(above, -kUp, false, 0, Vec3f(0.1f, 1, 0.1f)), 0.0f);
  EXPECT_GT(make(both).pdf_w(above, -kUp, false, 0, Vec3f(0.1f, 1, 0.1f)), 0.0f);
}

TEST(Lights, WhateverCanContributeHasADensity) {
  for (std::uint32_t seed = 0; seed < 30; ++seed) {
    const RandomScene scene(seed, true, true, seed % 2 == 0 ? 4 : 60);
    const Lights lights = scene.lights();
    PathRng rng(seed, Stream::kTest, 5, 0);
    for (int i = 0; i < 200; ++i) {
      const Vec3f p = sample_sphere(rng.next2()) * (4.0f * rng.next1()), n = sample_sphere(rng.next2());
      for (std::uint32_t k = 0; k < lights.triangle_count(); ++k) {
        const EmissiveTriangle& t = lights.triangle(k);
        const Vec2f b = sample_triangle(rng.next2());
        const Vec3f q = t.p0 * (1.0f - b.x - b.y) + t.p1 * b.x + t.p2 * b.y;
        const Vec3f wi = normalize(q - p);
        const float cosine = -dot(t.ng, wi);
        const bool contributes = dot(n, wi) > 1e-6f && (t.two_sided ? std::abs(cosine) : cosine) > 1e-4f;
        const float pdf = lights.pdf_w(p, n, false, k, q);
        ASSERT_TRUE(std::isfinite(pdf));
        if (contributes) {
          ASSERT_GT(pdf, 0.0f) << "seed " << seed << " triangle " << k;
        }
      }
    }
  }
}

TEST(Lights, EveryNumberThatIsReturnedIsFinite) {
  const RandomScene scene(3);
  const Lights lights = scene.lights();
  PathRng rng(1, Stream::kTest, 6, 0);
  const std::vector<float> corners = {0.0f, 1e-7f, 0.5f, kOneMinusEpsilon};
  const auto number = [&] {
    const auto k = static_cast<std::size_t>(8.0f * rng.next1());
    return k < corners.size() ? corners[k] : rng.next1();
  };
  for (int i = 0; i < 20000; ++i) {
    // On lights, at their corners, far away, and anywhere.
    Vec3f p = sample_sphere(rng.next2()) * std::pow(10.0f, 8.0f * rng.next1() - 4.0f);
    const EmissiveTriangle& t = scene.triangles[static_cast<std::size_t>(i) % scene.triangles.size()];
    if (i % 4 == 1) p = t.p0;
    if (i % 4 == 2) p = (t.p0 + t.p1) * 0.5f;
    if (i % 40 == 3) p = scene.punctual[0].position;
    const float pick = number(), x = number(), y = number();
    const auto s = lights.sample(p, sample_sphere(rng.next2()), i % 3 == 0, pick, Vec2f(x, y));
    if (s) {
      ASSERT_TRUE(is_finite(s->sample.wi) && is_finite(s->sample.radiance) && std::isfinite(s->sample.pdf_w));
      ASSERT_GT(s->sample.pdf_w, 0.0f);
      ASSERT_NEAR(length(s->sample.wi), 1.0f, 1e-5f);
    }
    const auto e = lights.emit(pick, Vec2f(x, y), Vec2f(number(), number()));
    ASSERT_TRUE(e);
    ASSERT_TRUE(is_finite(e->emission.origin) && is_finite(e->emission.direction) && is_finite(e->emission.flux));
    ASSERT_NEAR(length(e->emission.direction), 1.0f, 1e-5f);
  }
}

TEST(Lights, TreeBeatsUniformChoiceAmongTenThousandTriangles) {
  PathRng rng(21, Stream::kTest, 0, 0);
  std::vector<EmissiveTriangle> triangles;
  for (int i = 0; i < 10000; ++i) {
    const Vec3f at(100.0f * rng.next1(), 3.0f + rng.next1(), 100.0f * rng.next1());
    const Vec3f u = sample_sphere(rng.next2()) * 0.05f, v = sample_sphere(rng.next2()) * 0.05f;
    triangles.push_back(triangle(at, at + u, at + v, Rgb(rng.next1() < 0.01f ? 1000.0f : 10.0f), false));
  }
  const Lights lights = make(triangles, {}, nullptr, Box3f(Vec3f(0.0f), Vec3f(100.0f)));
  ASSERT_EQ(lights.area_lights().size(), 10000u);
  double tree = 0.0, uniform = 0.0;
  for (int k = 0; k < 4; ++k) {
    const Vec3f p(20.0f + 20.0f * static_cast<float>(k), 0, 45.0f);
    const Estimate by_tree = irradiance(lights, p, kUp, 20000);
    const Estimate by_chance = estimate(200000, [&](PathRng& r) {
      const auto i = std::min<std::size_t>(static_cast<std::size_t>(10000.0f * r.next1()), 9999);
      const auto s = lights.area_lights()[i].sample(p, r.next2());
      if (!s) return 0.0;
      return static_cast<double>(average(lights.area_lights()[i].radiance()) * std::max(0.0f, s->wi.y) /
                                 (s->pdf_w * 1e-4f));
    });
    EXPECT_NEAR(by_tree.mean, by_chance.mean, 4.5 * std::hypot(by_tree.deviation, by_chance.deviation));
    tree += by_tree.deviation * by_tree.deviation * 20000;
    uniform += by_chance.deviation * by_chance.deviation * 200000;
  }
  EXPECT_LT(tree * 20.0, uniform);
  RecordProperty("variance_ratio", std::to_string(uniform / tree));
}

TEST(Lights, ChoosesAmongLightsInOnePlaceAndOnALine) {
  std::vector<PunctualLight> lights;
  for (int i = 0; i < 200; ++i) {
    PunctualLight light;
    light.intensity = Rgb(1.0f);
    light.position = Vec3f(i < 100 ? 0.0f : static_cast<float>(i), 1, 0);
    lights.push_back(light);
  }
  double expected = 0.0;
  for (const PunctualLight& light : lights) expected += std::pow(static_cast<double>(length2(light.position)), -1.5);
  expect_irradiance(make({}, lights), Vec3f(0, 0, 0), kUp, expected);
}

TEST(Lights, LeavesOutWhatIsDegenerateOrBlack) {
  const Vec3f a(0, 0, 0), b(1, 0, 0), c(0, 0, 1);
  auto flat = triangle(a, b, c, Rgb(1.0f));
  flat.p2 = Vec3f(2, 0, 0);
  const Lights lights = make({flat, triangle(a, b, c, Rgb(0.0f)), triangle(a, b, c, Rgb(kInfinity))});
  EXPECT_TRUE(lights.empty());
  EXPECT_EQ(lights.triangle_count(), 3u);
  EXPECT_EQ(lights.pdf_w(Vec3f(0, -1, 0), kUp, false, 0, a), 0.0f);
  EXPECT_FALSE(lights.emit(0.5f, Vec2f(0.5f, 0.5f), Vec2f(0.5f, 0.5f)));
}

}  // namespace
}  // namespace pf
