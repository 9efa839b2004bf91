#include "worker/bsdf/albedo_table.h"

#include <algorithm>
#include <cmath>

#include "worker/bsdf/charlie.h"
#include "worker/bsdf/fresnel.h"
#include "worker/bsdf/ggx.h"

namespace pf {
namespace {

/// Albedo of GGX from one direction, split into the factors of F0 and F90: midpoint rule over the square that
/// Ggx::sample() takes. Half the circle of u.y suffices, the other is its mirror image.
struct Split {
  float f0, f90;
};
Split integrate_ggx(float cosine, float alpha) {
  constexpr int kRadii = 24, kAngles = 12;
  const Ggx ggx{alpha};
  const Vec3f wo(std::sqrt(std::max(0.0f, 1.0f - cosine * cosine)), 0.0f, cosine);
  double f0 = 0.0, f90 = 0.0;
  for (int i = 0; i < kRadii; ++i) {
    for (int j = 0; j < kAngles; ++j) {
      const Vec2f u((static_cast<float>(i) + 0.5f) / kRadii, -0.25f + 0.5f * (static_cast<float>(j) + 0.5f) / kAngles);
      const Vec3f h = ggx.sample(wo, u);
      const float c = dot(wo, h);
      const Vec3f wi = h * (2.0f * c) - wo;
      if (wi.z <= 0.0f || c <= 0.0f) continue;
      // f cos / pdf for F = 1, with pdf = visible_density / 4.
      const float weight =
          4.0f * ggx.distribution(h) * ggx.visibility(wo.z, wi.z) * wi.z / ggx.visible_density(wo.z, h);
      f0 += weight * (1.0f - schlick_weight(c));
      f90 += weight * schlick_weight(c);
    }
  }
  constexpr double kCount = kRadii * kAngles;
  return {static_cast<float>(f0 / kCount), static_cast<float>(f90 / kCount)};
}

GgxAlbedo make_ggx_albedo() {
  GgxAlbedo e;
  for (int row = 0; row < AlbedoTable::kRoughnesses; ++row) {
    const float r = AlbedoTable::roughness(row);
    for (int column = 0; column < AlbedoTable::kCosines; ++column) {
      const float c = std::max(AlbedoTable::cosine(column), 1e-4f);
      const float s = schlick_weight(c);
      const Split split = row == 0 ? Split{1.0f - s, s} : integrate_ggx(c, r * r);
      e.f0.set(column, row, split.f0);
      e.f90.set(column, row, split.f90);
    }
  }
  e.f0.finish();
  e.f90.finish();
  return e;
}

/// One column of the sheen table: midpoint rule over (sqrt(cos_i), azimuth); the square root because the lobe
/// sits at the horizon. All roughnesses share the logarithms.
AlbedoTable make_sheen_albedo() {
  constexpr int kSteps = 48, kAngles = 32;
  AlbedoTable table;
  for (int column = 0; column < AlbedoTable::kCosines; ++column) {
    const float cos_o = std::max(AlbedoTable::cosine(column), 1e-3f);
    const float sin_o = std::sqrt(std::max(0.0f, 1.0f - cos_o * cos_o));
    std::array<double, AlbedoTable::kRoughnesses> sum{};
    for (int i = 0; i < kSteps; ++i) {
      const float y = (static_cast<float>(i) + 0.5f) / kSteps;
      const float cos_i = y * y;
      const float sin_i = std::sqrt(1.0f - cos_i * cos_i);
      std::array<float, kAngles> log_sin2;
      for (int j = 0; j < kAngles; ++j) {
        const float cos_phi = std::cos(kPi * (static_cast<float>(j) + 0.5f) / kAngles);
        const float len2 = 2.0f * (1.0f + sin_o * sin_i * cos_phi + cos_o * cos_i);
        const float cos2 = (cos_o + cos_i) * (cos_o + cos_i) / len2;
        log_sin2[j] = std::log(std::max(1.0f - cos2, 1e-30f));
      }
      for (int row = 0; row < AlbedoTable::kRoughnesses; ++row) {
        const Charlie charlie(AlbedoTable::roughness(row));
        float d = 0.0f;
        for (const float l : log_sin2) d += std::exp(charlie.exponent() * l);
        const float masking = (1.0f + charlie.lambda(cos_o) + charlie.lambda(cos_i)) * 4.0f * cos_o;
        sum[row] += d * charlie.normalisation() / masking * 2.0f * y;
      }
    }
    constexpr double kCell = 2.0 * kPi / (kSteps * kAngles);
    for (int row = 0; row < AlbedoTable::kRoughnesses; ++row) {
      table.set(column, row, static_cast<float>(sum[row] * kCell));
    }
  }
  table.finish();
  return table;
}

/// Node below `x` of a uniform grid over [0,1] and the weight of the node above.
struct Cell {
  int node;
  float weight;
};
Cell locate(float x, int nodes) {
  const float scaled = std::clamp(x, 0.0f, 1.0f) * static_cast<float>(nodes - 1);
  const int node = std::min(static_cast<int>(scaled), nodes - 2);
  return {node, scaled - static_cast<float>(node)};
}
float mix(float a, float b, float t) { return a + (b - a) * t; }

}  // namespace

float AlbedoTable::cosine(int column) {
  const float x = static_cast<float>(column) / (kCosines - 1);
  return x * x;
}
float AlbedoTable::roughness(int row) { return static_cast<float>(row) / (kRoughnesses - 1); }

void AlbedoTable::finish() {
  // With cosine = x^2 the mean is the integral of 4 x^3 E(x); three Gauss points are exact for it in each
  // cell.
  constexpr double kPoint = 0.7745966692414834, kEdge = 5.0 / 18.0, kCentre = 8.0 / 18.0;
  constexpr std::array<std::array<double, 2>, 3> kGauss = {
      {{0.5 - 0.5 * kPoint, kEdge}, {0.5, kCentre}, {0.5 + 0.5 * kPoint, kEdge}}};
  for (int row = 0; row < kRoughnesses; ++row) {
    double sum = 0.0;
    for (int c = 0; c + 1 < kCosines; ++c) {
      for (const auto& [t, w] : kGauss) {
        const double x = (c + t) / (kCosines - 1);
        sum += w / (kCosines - 1) * 4.0 * x * x * x * ((1.0 - t) * rows_[row][c] + t * rows_[row][c + 1]);
      }
    }
    mean_[row] = static_cast<float>(sum);
  }
}

float AlbedoTable::at(float cosine, float roughness) const {
  const Cell c = locate(std::sqrt(std::max(cosine, 0.0f)), kCosines);
  const Cell r = locate(roughness, kRoughnesses);
  const auto& low = rows_[r.node];
  const auto& high = rows_[r.node + 1];
  return mix(mix(low[c.node], low[c.node + 1], c.weight), mix(high[c.node], high[c.node + 1], c.weight), r.weight);
}

float AlbedoTable::mean(float roughness) const {
  const Cell r = locate(roughness, kRoughnesses);
  return mix(mean_[r.node], mean_[r.node + 1], r.weight);
}

const GgxAlbedo& GgxAlbedo::get() {
  static const GgxAlbedo albedo = make_ggx_albedo();
  return albedo;
}

const AlbedoTable& sheen_albedo() {
  static const AlbedoTable table = make_sheen_albedo();
  return table;
}

}  // namespace pf
