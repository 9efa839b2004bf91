#pragma once

#include <array>
#include <cstddef>

#include "common/math/lanes.h"
#include "worker/bsdf/interface.h"

namespace pf {

/// Eight mirrors, sharp refractions and sheets (Interface with alpha 0), side by side; the same bits as each alone.
class InterfaceLanes {
 public:
  struct Sample {
    Vec3x8 wi;
    Vec3x8 weight;
    Int8 valid, transmitted;
  };

  /// None of them null.
  explicit InterfaceLanes(const std::array<const Interface*, kLanes>& boundaries) {
    static_assert(offsetof(Interface, f0) == 8 && offsetof(Interface, transmission) == 24 &&
                  offsetof(Interface, dielectric_f90) == 40 && offsetof(Interface, tint) == 52);
    std::array<Float8, kLanes> low, high;  // of an interface's sixteen floats
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      low[lane] = _mm256_loadu_ps(&boundaries[lane]->alpha);
      high[lane] = _mm256_loadu_ps(&boundaries[lane]->dielectric_f0.y);
      thin_[lane] = boundaries[lane]->through == Interface::Through::kThin ? -1 : 0;
    }
    transpose(low);
    transpose(high);
    f0_ = {low[2], low[3], low[4]};
    f90_ = low[5];
    transmission_ = low[6];
    dielectric_f0_ = {low[7], high[0], high[1]};
    dielectric_f90_ = high[2];
    exact_f0_ = high[3];
    eta_ = high[4];
    tint_ = {high[5], high[6], high[7]};
  }

  [[nodiscard]] const Int8& thin() const { return thin_; }
  /// Interface::sample() where the microfacet is the surface itself; `wo` local, above it. Not valid where nothing is
  /// reflected or transmitted.
  [[nodiscard]] Sample sample_mirror(const Vec3x8& wo, const Float8& u_choice) const {
    const Float8& c = wo.z;
    const Float8 schlick = schlick_weight(c);
    Vec3x8 reflected = between(f0_, f90_, schlick), transmitted{};
    const Int8 transmissive = transmission_ > 0.0f;
    if (lanes_of(transmissive) != 0) add_transmissive(c, schlick, reflected, transmitted);
    const Float8 r = average(reflected), t = average(transmitted);
    const Int8 mirrors = u_choice * (r + t) < r;
    const Float8 cos_t = refracted_cosine(c);
    const Vec3x8 mirrored{Float8{} - wo.x, Float8{} - wo.y, 2.0f * c - wo.z};
    const Float8 turned = 1.0f / eta_;
    const Vec3x8 refracted =
        normalize(Vec3x8{Float8{} - wo.x * turned, Float8{} - wo.y * turned, (c / eta_ - cos_t) - wo.z * turned});
    const Vec3x8 through = select(thin_, {mirrored.x, mirrored.y, -mirrored.z}, refracted);
    return {select(mirrors, mirrored, through), select(mirrors, reflected * ((r + t) / r), transmitted * ((r + t) / t)),
            (average(reflected + transmitted) > 0.0f) & (r + t > 0.0f) & (mirrors | (t > 0.0f)), ~mirrors};
  }

 private:
  [[nodiscard]] static Float8 schlick_weight(const Float8& cosine) {
    const Float8 m = min(max(1.0f - cosine, all(0.0f)), all(1.0f)), m2 = m * m;
    return m2 * m2 * m;
  }
  /// f0 + (f90 - f0) weight
  [[nodiscard]] static Vec3x8 between(const Vec3x8& f0, const Float8& f90, const Float8& weight) {
    return f0 + Vec3x8{f90 - f0.x, f90 - f0.y, f90 - f0.z} * weight;
  }
  [[nodiscard]] Float8 refracted_cosine(const Float8& c) const {
    const Float8 sin2_t = (1.0f - c * c) / (eta_ * eta_);
    return sin2_t < 1.0f ? sqrt(1.0f - sin2_t) : Float8{};
  }
  [[nodiscard]] Float8 fresnel(const Float8& c) const {
    const Float8 cos_t = refracted_cosine(c);
    const Float8 r_parallel = (eta_ * c - cos_t) / (eta_ * c + cos_t);
    const Float8 r_perpendicular = (c - eta_ * cos_t) / (c + eta_ * cos_t);
    const Float8 r = min(all(1.0f), 0.5f * (r_parallel * r_parallel + r_perpendicular * r_perpendicular));
    return cos_t <= 0.0f ? all(1.0f) : r;
  }
  /// Interface::transmissive_split() in its portion.
  void add_transmissive(const Float8& c, const Float8& schlick, Vec3x8& reflected, Vec3x8& transmitted) const {
    const Int8 absorbing = eta_ == kInfinity;
    const Float8 exact = fresnel(c);
    const Vec3x8 course = between(dielectric_f0_, dielectric_f90_, (exact - exact_f0_) / (1.0f - exact_f0_));
    const auto portion = [](const Float8& x) { return min(max(x, all(0.0f)), all(1.0f)); };
    Vec3x8 r = select(exact >= 1.0f, pf::all(Vec3f(1.0f)), {portion(course.x), portion(course.y), portion(course.z)});
    r = select(absorbing, between(dielectric_f0_, dielectric_f90_, schlick), r);
    const auto sheet = [](const Float8& x) { return 2.0f * x / (1.0f + x); };
    r = select(thin_, {sheet(r.x), sheet(r.y), sheet(r.z)}, r);
    Float8 passed = 1.0f - max_component(r);
    passed = absorbing & ~thin_ ? Float8{} : passed;
    const Int8 here = transmission_ > 0.0f;
    reflected = select(here, reflected + r * transmission_, reflected);
    transmitted = select(here, tint_ * passed * transmission_, transmitted);
  }

  Vec3x8 f0_, dielectric_f0_, tint_;
  Float8 f90_, transmission_, dielectric_f90_, exact_f0_, eta_;
  Int8 thin_{};
};

}  // namespace pf
