#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include <gtest/gtest.h>

#include "common/math/philox.h"
#include "common/math/sampling.h"
#include "worker/scene/lights.h"

/// Emitters, random scenes and Monte Carlo estimates that the tests of lights share.
namespace pf {

inline EmissiveTriangle triangle(const Vec3f& a, const Vec3f& b, const Vec3f& c, const Rgb& radiance,
                                 bool two_sided = false) {
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
inline std::vector<EmissiveTriangle> quad(const Vec3f& corner, const Vec3f& u, const Vec3f& v, const Rgb& radiance,
                                          bool two_sided = false) {
  return {triangle(corner + u, corner + v, corner, radiance, two_sided),
          triangle(corner + u, corner + u + v, corner + v, radiance, two_sided)};
}

inline Lights make(std::vector<EmissiveTriangle> triangles, std::vector<PunctualLight> punctual = {},
                   const EnvironmentMap* environment = nullptr,
                   const Box3f& bounds = Box3f(Vec3f(-1.0f), Vec3f(1.0f))) {
  return Lights(std::move(triangles), std::move(punctual), environment, bounds);
}

/// Mean and its standard deviation.
struct Estimate {
  double mean = 0, deviation = 0;
};

inline Estimate estimate(int samples, const std::function<double(PathRng&)>& f) {
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
inline Estimate irradiance(const Lights& lights, const Vec3f& p, const Vec3f& n, int samples) {
  return estimate(samples, [&](PathRng& rng) {
    const float pick = rng.next1();
    const auto s = lights.sample(p, n, false, pick, rng.next2());
    if (!s) return 0.0;
    EXPECT_GT(s->sample.pdf_w, 0.0f);
    EXPECT_TRUE(std::isfinite(s->sample.pdf_w));
    return static_cast<double>(average(s->sample.radiance) * std::max(0.0f, dot(s->sample.wi, n)) / s->sample.pdf_w);
  });
}

inline void expect_irradiance(const Lights& lights, const Vec3f& p, const Vec3f& n, double expected,
                              int samples = 40000) {
  const Estimate e = irradiance(lights, p, n, samples);
  EXPECT_NEAR(e.mean, expected, 5.0 * e.deviation + 1e-4 * expected);
}

inline const Vec3f kUp(0, 1, 0);

inline EnvironmentMap sky(const Rgb& radiance) {
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

}  // namespace pf
