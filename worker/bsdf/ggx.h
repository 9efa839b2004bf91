#pragma once

#include <algorithm>
#include <cmath>

#include "common/math/sampling.h"
#include "common/math/vec.h"

namespace pf {

/// Isotropic GGX (Trowbridge-Reitz) microfacets with height-correlated Smith masking [Walter et al. 2007;
/// Heitz 2014]. Directions are in the local frame whose z is the macroscopic normal; alpha > 0.
struct Ggx {
  float alpha;

  /// Density D of microfacet normals [1/sr], [Heitz 2014, eq. 84]. Written with the sine of h instead of
  /// 1 - cos^2: for narrow lobes the latter cancels to noise.
  [[nodiscard]] float distribution(const Vec3f& h) const {
    const float a2 = alpha * alpha;
    const float t = (h.x * h.x + h.y * h.y) / a2 + h.z * h.z;
    return kInvPi / (a2 * t * t);
  }

  /// G2 / (4 cos_o cos_i) with G2 = 1 / (1 + Lambda_o + Lambda_i) [Heitz 2014, eq. 99]; cosines positive.
  /// Finite at grazing angles. Also used for transmission, as in pbrt-v4.
  [[nodiscard]] float visibility(float cos_o, float cos_i) const {
    const float sum = cos_i * root(cos_o) + cos_o * root(cos_i);
    return sum > 0.0f ? 0.5f / sum : 0.0f;
  }

  /// Density D_v(h) / (o.h) of visible normals without the factor o.h: G1(o) D(h) / cos_o [Heitz 2018, eq.
  /// 3].
  [[nodiscard]] float visible_density(float cos_o, const Vec3f& h) const {
    return 2.0f * distribution(h) / (cos_o + root(cos_o));
  }

  /// A microfacet normal as seen from `wo` (wo.z > 0), density visible_density() * (wo.h)
  /// [Heitz 2018, "Sampling the GGX Distribution of Visible Normals", listing 1].
  [[nodiscard]] Vec3f sample(const Vec3f& wo, const Vec2f& u) const {
    const Vec3f v = normalize(Vec3f(alpha * wo.x, alpha * wo.y, wo.z));
    const float len2 = v.x * v.x + v.y * v.y;
    const Vec3f t1 = len2 > 0.0f ? Vec3f(-v.y, v.x, 0.0f) * (1.0f / std::sqrt(len2)) : Vec3f(1.0f, 0.0f, 0.0f);
    const Vec3f t2 = cross(v, t1);
    const float r = std::sqrt(u.x);
    const float phi = 2.0f * kPi * u.y;
    const float x = r * std::cos(phi);
    const float s = 0.5f * (1.0f + v.z);
    const float y = (1.0f - s) * std::sqrt(std::max(0.0f, 1.0f - x * x)) + s * r * std::sin(phi);
    const Vec3f n = t1 * x + t2 * y + v * std::sqrt(std::max(0.0f, 1.0f - x * x - y * y));
    return normalize(Vec3f(alpha * n.x, alpha * n.y, std::max(1e-6f, n.z)));
  }

 private:
  /// sqrt(cos^2 + alpha^2 sin^2) = cos (1 + 2 Lambda).
  [[nodiscard]] float root(float cosine) const {
    const float a2 = alpha * alpha;
    return std::sqrt(a2 + (1.0f - a2) * cosine * cosine);
  }
};

}  // namespace pf
