// sample() against pdf() and eval(): chi-square tests over the sphere, and the identity weight = f cos / pdf.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "tests/unit/bsdf/materials.h"

namespace pf::test {
namespace {

/// Upper tail of the chi-square distribution: the regularised incomplete gamma function Q(k/2, x/2), by its
/// series or its continued fraction [Abramowitz and Stegun, 6.5.29 and 6.5.31].
double chi_square_tail(double x2, double freedom) {
  const double a = 0.5 * freedom, x = 0.5 * x2;
  if (x <= 0.0) return 1.0;
  const double front = std::exp(-x + a * std::log(x) - std::lgamma(a));
  if (x < a + 1.0) {
    double term = 1.0 / a, sum = term;
    for (int n = 1; n < 2000 && term > 1e-16 * sum; ++n) sum += term *= x / (a + n);
    return 1.0 - front * sum;
  }
  double b = x + 1.0 - a, c = 1e300, d = 1.0 / b, h = d;
  for (int n = 1; n < 2000; ++n) {
    const double an = -n * (n - a);
    b += 2.0;
    d = 1.0 / (an * d + b);
    c = b + an / c;
    h *= d * c;
    if (std::abs(d * c - 1.0) < 1e-15) break;
  }
  return front * h;
}

/// Cells over the sphere around an axis: rings of polar angle pi (i/n)^warp (warp 0: equal steps of the
/// cosine).
struct Grid {
  /// Across the plane of all wo of this test: the poles' large cells then lie away from every lobe's peak.
  Frame frame = Frame::from_normal({-std::sin(0.4f), std::cos(0.4f), 0.0f});
  double warp = 0.0;
  static constexpr int kRings = 24, kSectors = 24;

  [[nodiscard]] double cosine(double ring) const {
    const double t = ring / kRings;
    return warp == 0.0 ? 1.0 - 2.0 * t : std::cos(std::numbers::pi * std::pow(t, warp));
  }
  [[nodiscard]] std::size_t cell(const Vec3f& world) const {
    const Vec3f v = frame.to_local(world);
    // The angle by both its sine and cosine: narrow rings around the pole need the former.
    const double theta = std::atan2(std::hypot(v.x, v.y), v.z);
    const double t = warp == 0.0 ? 0.5 * (1.0 - std::cos(theta)) : std::pow(theta / std::numbers::pi, 1.0 / warp);
    const double phi = std::atan2(v.y, v.x) / (2.0 * std::numbers::pi);
    const int ring = std::clamp(static_cast<int>(t * kRings), 0, kRings - 1);
    const int sector = std::clamp(static_cast<int>((phi < 0 ? phi + 1.0 : phi) * kSectors), 0, kSectors - 1);
    return static_cast<std::size_t>(ring * kSectors + sector);
  }
  /// Midpoint rule with n x n points in one cell.
  [[nodiscard]] double integrate_cell(const Bsdf& bsdf, const Vec3f& wo, Portion portion, int ring, int sector,
                                      int n) const {
    double sum = 0.0;
    for (int i = 0; i < n; ++i) {
      const double low = ring + static_cast<double>(i) / n, high = low + 1.0 / n;
      const double ring_area = (cosine(low) - cosine(high)) * 2.0 * std::numbers::pi / (kSectors * n);
      const double theta = warp == 0.0 ? std::acos(cosine(0.5 * (low + high)))
                                       : std::numbers::pi * std::pow(0.5 * (low + high) / kRings, warp);
      const double st = std::sin(theta), ct = std::cos(theta);
      for (int j = 0; j < n; ++j) {
        const double phi = 2.0 * std::numbers::pi * (sector + (j + 0.5) / n) / kSectors;
        const Vec3f v(static_cast<float>(st * std::cos(phi)), static_cast<float>(st * std::sin(phi)),
                      static_cast<float>(ct));
        sum += ring_area * bsdf.pdf(wo, frame.to_world(v), Transport::kRadiance, portion);
      }
    }
    return sum;
  }
  /// pdf() over every cell, refined until the result settles well below the noise of the counts.
  [[nodiscard]] std::vector<double> integrate(const Bsdf& bsdf, const Vec3f& wo, Portion portion) const {
    std::vector<double> cells;
    for (int ring = 0; ring < kRings; ++ring) {
      for (int sector = 0; sector < kSectors; ++sector) {
        double coarse = integrate_cell(bsdf, wo, portion, ring, sector, 5);
        double fine = integrate_cell(bsdf, wo, portion, ring, sector, 8);
        for (int n = 16; n <= 256 && std::abs(fine - coarse) > 2e-6 + 2e-3 * fine; n *= 2) {
          coarse = fine;
          fine = integrate_cell(bsdf, wo, portion, ring, sector, n);
        }
        cells.push_back(fine);
      }
    }
    return cells;
  }
};

struct Outcome {
  double p_value = 1.0;
  double integral = 0.0;   ///< of pdf() over the sphere
  double scattered = 0.0;  ///< share of sample() calls that returned a non-delta direction
};

Outcome chi_square(const Bsdf& bsdf, const Vec3f& wo, Portion portion, const Grid& grid, std::uint32_t seed) {
  constexpr int kSamples = 60000;
  const std::vector<double> density = grid.integrate(bsdf, wo, portion);
  std::vector<double> counts(density.size(), 0.0);
  Random random(seed);
  double scattered = 0.0;
  for (int i = 0; i < kSamples; ++i) {
    const auto s = bsdf.sample(wo, random.uniform(), random.square(), Transport::kRadiance, portion);
    if (!s || s->delta) continue;
    counts[grid.cell(s->wi)] += 1.0;
    scattered += 1.0;
  }
  Outcome out;
  for (const double d : density) out.integral += d;
  out.scattered = scattered / kSamples;
  // One more cell: the calls that failed or returned a mirror direction. Cells expecting fewer than 5 are
  // pooled.
  counts.push_back(kSamples - scattered);
  double x2 = 0.0, pooled = 0.0, pooled_count = 0.0, cells = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const double expected = kSamples * (i < density.size() ? density[i] : std::max(0.0, 1.0 - out.integral));
    if (expected < 5.0) {
      pooled += expected;
      pooled_count += counts[i];
      continue;
    }
    x2 += (counts[i] - expected) * (counts[i] - expected) / expected;
    cells += 1.0;
  }
  if (pooled >= 5.0) {
    x2 += (pooled_count - pooled) * (pooled_count - pooled) / pooled;
    cells += 1.0;
  } else if (pooled_count > 40.0) {
    out.p_value = 0.0;  // practically impossible counts where nothing was expected
    return out;
  }
  if (cells > 1.0) out.p_value = chi_square_tail(x2, cells - 1.0);
  return out;
}

struct Configuration {
  std::string name;
  SurfaceParams params;
  Vec3f wo;
  Portion portion;
  Grid grid;
};

std::vector<Configuration> configurations() {
  std::vector<Configuration> all;
  const auto add = [&all](const std::string& name, const SurfaceParams& p, float degrees, const Grid& grid) {
    for (const Portion portion : kPortions) {
      all.push_back({name + " at " + std::to_string(degrees) + " portion " + std::to_string(static_cast<int>(portion)),
                     p, at_angle(degrees), portion, grid});
    }
  };
  for (const NamedMaterial& m : all_materials()) {
    for (const float degrees : {5.0f, 50.0f, 80.0f, 140.0f}) add(m.name, m.params, degrees, {});
  }
  for (const NamedMaterial& m : all_materials()) add(m.name + " tilted", tilted(m.params, 25.0f), 45.0f, {});
  // Narrow lobes need cells that shrink towards the mirrored or refracted direction.
  for (const float roughness : {0.05f, 0.12f}) {
    const Vec3f wo = at_angle(35.0f);
    Grid mirror;
    mirror.warp = 3.0;
    mirror.frame = Frame::from_normal({-wo.x, -wo.y, wo.z});
    add("MetalNarrow", metal(roughness), 35.0f, mirror);
    Grid refracted = mirror;
    const float sin_t = std::sin(35.0f * kPi / 180.0f) / 1.5f;
    refracted.frame = Frame::from_normal(
        normalize(Vec3f(-std::cos(0.4f) * sin_t, -std::sin(0.4f) * sin_t, -std::sqrt(1.0f - sin_t * sin_t))));
    add("GlassNarrow", glass(roughness), 35.0f, refracted);
  }
  return all;
}

TEST(BsdfSampling, ChiSquareTailMatchesPublishedQuantiles) {
  EXPECT_NEAR(chi_square_tail(18.307, 10), 0.05, 1e-5);
  EXPECT_NEAR(chi_square_tail(135.807, 100), 0.01, 1e-5);
  EXPECT_NEAR(chi_square_tail(1.0, 1), 0.3173105, 1e-6);
}

TEST(BsdfSampling, DirectionsFollowThePdfForEveryMaterialAngleAndPortion) {
  const std::vector<Configuration> all = configurations();
  // Sidak: the chance that any of the tests fails by accident is 1 %.
  const double threshold = 1.0 - std::pow(0.99, 1.0 / static_cast<double>(all.size()));
  std::uint32_t seed = 1;
  for (const Configuration& c : all) {
    const Bsdf bsdf(c.params, c.wo);
    if (bsdf.is_black() || bsdf.is_delta_only()) continue;
    const Outcome out = chi_square(bsdf, c.wo, c.portion, c.grid, seed++);
    EXPECT_GT(out.p_value, threshold) << c.name;
    // pdf() integrates to what sample() returns; the rest are failures and mirror directions.
    EXPECT_NEAR(out.integral, out.scattered, 0.012) << c.name;
    EXPECT_LT(out.integral, 1.0 + 2e-3) << c.name;
  }
}

TEST(BsdfSampling, WeightIsValueTimesCosineOverPdf) {
  Random random(7);
  for (const NamedMaterial& m : all_materials()) {
    for (const float tilt : {0.0f, 15.0f}) {
      for (const float degrees : {3.0f, 55.0f, 84.0f, 130.0f}) {
        const SurfaceParams p = tilted(m.params, tilt);
        const Vec3f wo = at_angle(degrees);
        const Bsdf bsdf(p, wo);
        for (const Portion portion : kPortions) {
          for (const Transport mode : kTransports) {
            for (int i = 0; i < 200; ++i) {
              const auto s = bsdf.sample(wo, random.uniform(), random.square(), mode, portion);
              if (!s || s->delta) continue;
              const float pdf = bsdf.pdf(wo, s->wi, mode, portion);
              float cosine = std::abs(dot(s->wi, bsdf.ns()));
              if (mode == Transport::kFlux) {
                cosine = dot(wo, bsdf.ns()) * std::abs(dot(s->wi, bsdf.ng())) / dot(wo, bsdf.ng());
              }
              const Rgb expected = bsdf.eval(wo, s->wi, mode, portion) * (cosine / pdf);
              ASSERT_NEAR(s->pdf_w, pdf, 2e-4f * pdf) << m.name;
              for (int k = 0; k < 3; ++k) {
                ASSERT_NEAR(s->weight[k], expected[k], 5e-4f * (expected[k] + 1e-3f)) << m.name << ' ' << degrees;
              }
              ASSERT_EQ(s->transmitted, dot(s->wi, bsdf.ng()) < 0.0f) << m.name;
            }
          }
        }
      }
    }
  }
}

TEST(BsdfSampling, GatherAndFollowAddUpToAll) {
  Random random(9);
  for (const NamedMaterial& m : all_materials()) {
    for (int i = 0; i < 500; ++i) {
      const Vec3f wo = random.sphere(), wi = random.sphere();
      const Bsdf bsdf(m.params, wo);
      const Rgb all = bsdf.eval(wo, wi, Transport::kRadiance);
      const Rgb sum = bsdf.eval(wo, wi, Transport::kRadiance, Portion::kGather) +
                      bsdf.eval(wo, wi, Transport::kRadiance, Portion::kFollow);
      for (int k = 0; k < 3; ++k) ASSERT_NEAR(all[k], sum[k], 1e-5f * (1.0f + all[k])) << m.name;
    }
  }
}

TEST(BsdfSampling, MirrorsAreFollowedAndDiffuseIsGathered) {
  Random random(10);
  for (int i = 0; i < 1000; ++i) {
    const Vec3f wo = at_angle(40.0f);
    const float u = random.uniform();
    const Vec2f v = random.square();
    EXPECT_FALSE(Bsdf(metal(0.0f), wo).sample(wo, u, v, Transport::kRadiance, Portion::kGather));
    EXPECT_FALSE(Bsdf(lambert(Rgb(1.0f)), wo).sample(wo, u, v, Transport::kRadiance, Portion::kFollow));
    const auto followed = Bsdf(plastic(0.0f), wo).sample(wo, u, v, Transport::kRadiance, Portion::kFollow);
    ASSERT_TRUE(followed && followed->delta);
    EXPECT_EQ(followed->specularity, 1.0f);
    const auto gathered = Bsdf(plastic(0.0f), wo).sample(wo, u, v, Transport::kRadiance, Portion::kGather);
    ASSERT_TRUE(!gathered || !gathered->delta);
  }
}

TEST(BsdfSampling, GatherShareRisesSmoothlyFromMirrorsToRoughSurfaces) {
  EXPECT_EQ(Bsdf::gather_share(0.0f), 0.0f);
  EXPECT_EQ(Bsdf::gather_share(0.01f), 0.0f);
  EXPECT_EQ(Bsdf::gather_share(0.5f), 1.0f);
  EXPECT_EQ(Bsdf::gather_share(1.0f), 1.0f);
  float last = 0.0f;
  for (int i = 0; i <= 1000; ++i) {
    const float r = static_cast<float>(i) / 1000.0f;
    const float g = Bsdf::gather_share(r * r);
    EXPECT_GE(g, last);
    EXPECT_LE(g - last, 3.0f / 1000.0f) << "a jump in roughness at " << r;
    last = g;
  }
}

}  // namespace
}  // namespace pf::test
