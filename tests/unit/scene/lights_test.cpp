#include "worker/scene/lights.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "common/math/philox.h"
#include "common/math/sampling.h"
#include "worker/scene/punctual.h"
#include "worker/scene/spherical_shapes.h"

namespace pf {
namespace {

EmissiveTriangle triangle(const Vec3f& a, const Vec3f& b, const Vec3f& c, const Rgb& radiance, bool two_sided = false) {
  EmissiveTriangle t;
  t.p0 = a;
  t.p1 = b;
  t.p2 = c;
  t.ng = normalize(cross(b - a, c - a));
  t.radiance = radiance;
  t.two_sided = two_sided;
  return t;
}

/// Parallelogram of two triangles that list their corners in different orders.
std::vector<EmissiveTriangle> quad(const Vec3f& corner, const Vec3f& u, const Vec3f& v, const Rgb& radiance,
                                   bool two_sided = false) {
  return {triangle(corner + u, corner + v, corner, radiance, two_sided),
          triangle(corner + u, corner + u + v, corner + v, radiance, two_sided)};
}

Lights make(std::vector<EmissiveTriangle> triangles, std::vector<PunctualLight> punctual = {},
            const EnvironmentMap* environment = nullptr, const Box3f& bounds = Box3f(Vec3f(-1.0f), Vec3f(1.0f))) {
  return Lights(std::move(triangles), std::move(punctual), environment, bounds);
}

/// Mean and its standard deviation.
struct Estimate {
  double mean = 0, deviation = 0;
};

Estimate estimate(int samples, const std::function<double(PathRng&)>& f) {
  PathRng rng(11, Stream::kTest, 0, 0);
  double sum = 0.0, square = 0.0;
  for (int i = 0; i < samples; ++i) {
    const double x = f(rng);
    sum += x;
    square += x * x;
  }
  const double mean = sum / samples;
  return {mean, std::sqrt(std::max(0.0, square / samples - mean * mean) / samples)};
}

/// Unoccluded irradiance at p by next-event estimation.
Estimate irradiance(const Lights& lights, const Vec3f& p, const Vec3f& n, int samples) {
  return estimate(samples, [&](PathRng& rng) {
    const float pick = rng.next1();
    const auto s = lights.sample(p, n, false, pick, rng.next2());
    if (!s) return 0.0;
    EXPECT_GT(s->sample.pdf_w, 0.0f);
    EXPECT_TRUE(std::isfinite(s->sample.pdf_w));
    return static_cast<double>(average(s->sample.radiance) * std::max(0.0f, dot(s->sample.wi, n)) / s->sample.pdf_w);
  });
}

void expect_irradiance(const Lights& lights, const Vec3f& p, const Vec3f& n, double expected, int samples = 40000) {
  const Estimate e = irradiance(lights, p, n, samples);
  EXPECT_NEAR(e.mean, expected, 5.0 * e.deviation + 1e-4 * expected);
}

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

const Vec3f kUp(0, 1, 0);

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
      if (ring + 1 < kRings) sphere.push_back(triangle(at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k), Rgb(3.0f)));
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
  expect_irradiance(lights, Vec3f(2.0f * std::tan(0.4f), 0, 0), kUp, 8.0 * ramp * ramp * cosine / (4.0 / cosine / cosine),
                    10);
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

EnvironmentMap sky(const Rgb& radiance) {
  std::vector<std::string> warnings;
  return *EnvironmentMap::load({"", radiance}, warnings);
}

/// One of each: quads, lone triangles, points, spots, sun and sky, at random.
struct RandomScene {
  std::vector<EmissiveTriangle> triangles;
  std::vector<PunctualLight> punctual;
  EnvironmentMap environment;

  explicit RandomScene(std::uint32_t seed, bool with_delta = true, bool with_sky = true, int count = 12) {
    PathRng rng(seed, Stream::kTest, 1, 0);
    const auto vector = [&](float scale) { return sample_sphere(rng.next2()) * (scale * rng.next1()); };
    const auto color = [&] { return Rgb(rng.next1(), rng.next1(), rng.next1()) * (rng.next1() < 0.2f ? 50.0f : 2.0f); };
    for (int i = 0; i < count; ++i) {
      const Vec3f at = vector(3.0f), u = vector(1.5f), v = vector(1.5f);
      const bool two_sided = rng.next1() < 0.4f;
      if (i % 3 == 0) {
        triangles.push_back(triangle(at, at + u, at + v, color(), two_sided));
      } else {
        const auto both = quad(at, u, i % 3 == 1 ? v : v - u * (dot(u, v) / length2(u)), color(), two_sided);
        triangles.insert(triangles.end(), both.begin(), both.end());
      }
    }
    if (with_delta) {
      for (const PunctualKind kind : {PunctualKind::kPoint, PunctualKind::kSpot, PunctualKind::kDirectional}) {
        PunctualLight light;
        light.kind = kind;
        light.intensity = color();
        light.position = vector(3.0f);
        light.direction = sample_sphere(rng.next2());
        light.cos_outer = 0.5f * rng.next1();
        light.cos_inner = light.cos_outer + (1.0f - light.cos_outer) * rng.next1();
        punctual.push_back(light);
      }
    }
    if (with_sky) environment = sky(Rgb(0.3f, 0.4f, 0.5f));
  }
  [[nodiscard]] Lights lights() const {
    return Lights(triangles, punctual, &environment, Box3f(Vec3f(-3.0f), Vec3f(3.0f)));
  }
};

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

TEST(Lights, EverySampleOfASolidAngleIsEquallyLikely) {
  // The mean of 1/pdf is the solid angle; and the counts over a grid of directions fit the density.
  const Vec3f p(0.2f, 0, 0.1f);
  for (const bool rectangle : {true, false}) {
    const Vec3f corner(-0.4f, 0.5f, -0.3f), u(1, 0, 0), v = rectangle ? Vec3f(0, 0.2f, 0.8f) : Vec3f(0.4f, 0.2f, 0.8f);
    const Lights lights = make(quad(corner, u, v, Rgb(1.0f), true));
    const Vec3d o = Vec3d(corner) - Vec3d(p), eu(u), ev(v);
    const double solid_angle = triangle_solid_angle(o, o + eu, o + ev) + triangle_solid_angle(o + eu + ev, o + ev, o + eu);
    constexpr int kGrid = 8, kSamples = 64000;
    std::vector<double> counts(kGrid * kGrid, 0.0), expected(kGrid * kGrid, 0.0);
    PathRng rng(9, Stream::kTest, 0, 0);
    for (int i = 0; i < kSamples; ++i) {
      const auto s = lights.sample(p, kUp, true, 0.5f, rng.next2());
      ASSERT_TRUE(s);
      ASSERT_NEAR(1.0 / static_cast<double>(s->sample.pdf_w), solid_angle, 1e-5);
      // Position on the parallelogram by least squares.
      const Vec3d q = Vec3d(p + s->sample.wi * s->sample.distance) - Vec3d(corner);
      const double uu = eu.dot(eu), uv = eu.dot(ev), vv = ev.dot(ev), qu = q.dot(eu), qv = q.dot(ev);
      const double a = (qu * vv - qv * uv) / (uu * vv - uv * uv), b = (qv * uu - qu * uv) / (uu * vv - uv * uv);
      const auto cell = [](double x) { return std::clamp(static_cast<int>(x * kGrid), 0, kGrid - 1); };
      counts[static_cast<std::size_t>(cell(b) * kGrid + cell(a))] += 1.0;
    }
    double chi2 = 0.0;
    for (int y = 0; y < kGrid; ++y) {
      for (int x = 0; x < kGrid; ++x) {
        const Vec3d c = o + eu * (static_cast<double>(x) / kGrid) + ev * (static_cast<double>(y) / kGrid);
        const Vec3d du = eu / kGrid, dv = ev / kGrid;
        const double cell = triangle_solid_angle(c, c + du, c + dv) + triangle_solid_angle(c + du + dv, c + dv, c + du);
        const double mean = cell / solid_angle * kSamples;
        const double count = counts[static_cast<std::size_t>(y * kGrid + x)];
        chi2 += (count - mean) * (count - mean) / mean;
      }
    }
    EXPECT_LT(chi2, 120.0) << "63 degrees of freedom: p = 2e-5";
  }
}

TEST(Lights, BothTrianglesOfAParallelogramHaveOneDensity) {
  const Lights lights = make(quad(Vec3f(0, 1, 0), Vec3f(1, 0, 0), Vec3f(0.5f, 0, 1), Rgb(1.0f)));
  ASSERT_EQ(lights.area_lights().size(), 1u);
  EXPECT_FALSE(lights.area_lights()[0].is_rectangle());
  const Vec3f p(0, 0, 0), q(0.7f, 1, 0.5f);
  EXPECT_GT(lights.pdf_w(p, kUp, false, 0, q), 0.0f);
  EXPECT_EQ(lights.pdf_w(p, kUp, false, 0, q), lights.pdf_w(p, kUp, false, 1, q));
}

TEST(Lights, PointsOfAParallelogramFindTheirTriangleWhateverTheOrderOfCorners) {
  for (int order = 0; order < 6; ++order) {
    auto pair = quad(Vec3f(0, 1, 0), Vec3f(1, 0, 0), Vec3f(0.5f, 0, 1), Rgb(1.0f));
    EmissiveTriangle& t = pair[1];  // its normal stays, as for the mirrored triangles of an instance
    if (order % 2 == 1) std::swap(t.p0, t.p1);
    for (int turn = 0; turn < order / 2; ++turn) {
      std::swap(t.p0, t.p1);
      std::swap(t.p1, t.p2);
    }
    const Lights lights = make(pair);
    ASSERT_EQ(lights.area_lights().size(), 1u);
    PathRng rng(2, Stream::kTest, 0, 0);
    for (int i = 0; i < 200; ++i) {
      const auto point = lights.area_lights()[0].sample_uniform(rng.next2());
      const EmissiveTriangle& found = lights.triangle(point.triangle);
      const Vec2f b = point.barycentric;
      const Vec3f q = found.p0 * (1.0f - b.x - b.y) + found.p1 * b.x + found.p2 * b.y;
      ASSERT_LT(length(q - point.position), 1e-5f) << "order " << order << " triangle " << point.triangle;
      ASSERT_GE(std::min({b.x, b.y, 1.0f - b.x - b.y}), -1e-5f);
    }
  }
}

TEST(Lights, OnlyFlatPairsThatShineAlikeAreMerged) {
  const Vec3f corner(0, 0, 0), u(1, 0, 0), v(0, 0, 1);
  auto pair = quad(corner, u, v, Rgb(1.0f));
  EXPECT_EQ(make(pair).area_lights().size(), 1u);
  pair[1].radiance = Rgb(2.0f);
  EXPECT_EQ(make(pair).area_lights().size(), 2u);
  pair = quad(corner, u, v, Rgb(1.0f));
  pair[1].two_sided = true;
  EXPECT_EQ(make(pair).area_lights().size(), 2u);
  pair = quad(corner, u, v, Rgb(1.0f));
  pair[1].p1 += Vec3f(0, 0.1f, 0);  // bent
  EXPECT_EQ(make(pair).area_lights().size(), 2u);
  pair = quad(corner, u, v, Rgb(1.0f));
  pair[1].p1 += Vec3f(0.1f, 0, 0);  // a kite
  EXPECT_EQ(make(pair).area_lights().size(), 2u);
  // A grid becomes its rectangles, not slanted pairs across them.
  std::vector<EmissiveTriangle> grid;
  for (int i = 0; i < 16; ++i) {
    const auto cell = quad(Vec3f(static_cast<float>(i % 4), 0, static_cast<float>(i / 4)), u, v, Rgb(1.0f));
    grid.insert(grid.begin(), cell.begin(), cell.end());
  }
  const Lights lights = make(grid);
  ASSERT_EQ(lights.area_lights().size(), 16u);
  for (const AreaLight& light : lights.area_lights()) EXPECT_TRUE(light.is_rectangle());
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

TEST(Lights, EmissionCarriesTheTotalFlux) {
  for (std::uint32_t seed = 0; seed < 5; ++seed) {
    const RandomScene scene(seed);
    const Lights lights = scene.lights();
    for (int c = 0; c < 3; ++c) {
      const Estimate e = estimate(20000, [&](PathRng& rng) {
        const float pick = rng.next1();
        const Vec2f position = rng.next2();
        return static_cast<double>(lights.emit(pick, position, rng.next2())->emission.flux[c]);
      });
      const auto expected = static_cast<double>(lights.total_flux()[c]);
      EXPECT_NEAR(e.mean, expected, 5.0 * e.deviation + 1e-5 * expected);
    }
    // The mean of the channels is the same for every photon.
    const Estimate e = estimate(5000, [&](PathRng& rng) {
      const float pick = rng.next1();
      const Vec2f position = rng.next2();
      return static_cast<double>(average(lights.emit(pick, position, rng.next2())->emission.flux));
    });
    EXPECT_LT(e.deviation, 1e-5 * e.mean);
  }
}

TEST(Lights, TotalFluxIsTheSumOfTheClosedForms) {
  PunctualLight point, spot, sun;
  point.intensity = Rgb(2.0f);
  spot.kind = PunctualKind::kSpot;
  spot.intensity = Rgb(3.0f);
  spot.cos_inner = 0.9f;
  spot.cos_outer = 0.6f;
  sun.kind = PunctualKind::kDirectional;
  sun.intensity = Rgb(5.0f);
  const EnvironmentMap environment = sky(Rgb(0.5f));
  auto triangles = quad(Vec3f(0, 0, 0), Vec3f(2, 0, 0), Vec3f(0, 0, 3), Rgb(7.0f), true);
  triangles.push_back(triangle(Vec3f(5, 0, 0), Vec3f(6, 0, 0), Vec3f(5, 1, 0), Rgb(11.0f)));
  const Lights lights = make(triangles, {point, spot, sun}, &environment);
  const double disc = M_PI * 3.0;  // radius sqrt(3) around the box of half-size 1
  const double expected = M_PI * 7.0 * 6.0 * 2.0 + M_PI * 11.0 * 0.5 + 4.0 * M_PI * 2.0 +
                          3.0 * 2.0 * M_PI * (0.1 + 0.3 / 3.0) + 5.0 * disc + 0.5 * 4.0 * M_PI * disc;
  EXPECT_NEAR(lights.total_flux().x, expected, 1e-5 * expected);
  EXPECT_FALSE(lights.empty());
  EXPECT_TRUE(make({}).empty());
  EXPECT_FALSE(make({}).emit(0.5f, Vec2f(0.5f, 0.5f), Vec2f(0.5f, 0.5f)));
  EXPECT_FALSE(make({}).sample(Vec3f(0.0f), kUp, false, 0.5f, Vec2f(0.5f, 0.5f)));
}

TEST(Lights, PhotonsFollowTheAngularDistributionOfTheirLight) {
  PunctualLight spot;
  spot.kind = PunctualKind::kSpot;
  spot.direction = normalize(Vec3f(1, 2, -1));
  for (const auto& [inner, outer] : {std::pair(0.9f, 0.5f), std::pair(0.9999f, 0.9995f), std::pair(1.0f, -0.5f)}) {
    spot.cos_inner = inner;
    spot.cos_outer = outer;
    const SpotCone cone(spot);
    // Numeric integral of the falloff, and the mean of f over the sampled density, against closed forms.
    double integral = 0.0, second = 0.0;
    constexpr int kSteps = 200000;
    const double low = static_cast<double>(outer);
    for (int i = 0; i < kSteps; ++i) {
      const auto f = static_cast<double>(cone.falloff(static_cast<float>(low + (1.0 - low) * (i + 0.5) / kSteps)));
      integral += 2.0 * M_PI * f * (1.0 - low) / kSteps;
      second += 2.0 * M_PI * f * f * (1.0 - low) / kSteps;
    }
    EXPECT_NEAR(static_cast<double>(cone.solid_angle()) / integral, 1.0, 2e-3);
    const Lights lights = make({}, {spot});
    const Estimate e = estimate(40000, [&](PathRng& rng) {
      const Vec2f position = rng.next2();
      const auto picked = lights.emit(0.5f, position, rng.next2());
      EXPECT_EQ(picked->emission.origin, spot.position);
      return static_cast<double>(cone.falloff(dot(picked->emission.direction, spot.direction)));
    });
    EXPECT_NEAR(e.mean, second / integral, 5.0 * e.deviation + 4e-3);
  }

  const Lights area = make(quad(Vec3f(0, 1, 0), Vec3f(1, 0, 0), Vec3f(0, 0, 1), Rgb(1.0f), true));
  int above = 0;
  const Estimate cosine = estimate(40000, [&](PathRng& rng) {
    const float pick = rng.next1();
    const Vec2f position = rng.next2();
    const auto e = area.emit(pick, position, rng.next2());
    const float y = e->emission.direction.y;
    above += y > 0.0f ? 1 : 0;
    EXPECT_GT((e->emission.origin.y - 1.0f) * y, 0.0f);  // starts on the side it leaves to
    EXPECT_NEAR(e->emission.origin.y, 1.0f, 1e-4f);
    EXPECT_TRUE(e->triangle == 0 || e->triangle == 1);
    EXPECT_EQ(e->emission.light, static_cast<std::uint32_t>(e->triangle));
    return static_cast<double>(std::abs(y));
  });
  EXPECT_NEAR(cosine.mean, 2.0 / 3.0, 5.0 * cosine.deviation);
  EXPECT_NEAR(above, 20000, 500);
}

TEST(Lights, DistantPhotonsComeFromOutsideAndGiveTheIrradianceInside) {
  PunctualLight sun;
  sun.kind = PunctualKind::kDirectional;
  sun.intensity = Rgb(5.0f);
  sun.direction = normalize(Vec3f(1, -2, 0.5f));
  const EnvironmentMap environment = sky(Rgb(0.5f));
  const Box3f bounds(Vec3f(-1, -1, -1), Vec3f(3, 1, 1));
  const Vec3f center(1, 0, 0);
  const float radius = std::sqrt(6.0f);
  for (const bool use_sky : {false, true}) {
    const Lights lights = use_sky ? make({}, {}, &environment, bounds) : make({}, {sun}, nullptr, bounds);
    // Flux through a horizontal square of side 1 in the middle, from above.
    const Estimate e = estimate(100000, [&](PathRng& rng) {
      const Vec2f position = rng.next2();
      const auto picked = lights.emit(0.5f, position, rng.next2());
      const Emission& emission = picked->emission;
      EXPECT_LE(dot(emission.origin - center, emission.direction), -radius);
      const float t = -emission.origin.y / emission.direction.y;
      const Vec3f at = emission.origin + emission.direction * t;
      const bool through = emission.direction.y < 0.0f && std::abs(at.x - 1.0f) < 0.5f && std::abs(at.z) < 0.5f;
      return through ? static_cast<double>(emission.flux.x) : 0.0;
    });
    const double expected = use_sky ? 0.5 * M_PI : 5.0 * static_cast<double>(-sun.direction.y);
    EXPECT_NEAR(e.mean, expected, 5.0 * e.deviation);
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
