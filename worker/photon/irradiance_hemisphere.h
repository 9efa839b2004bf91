#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/math/frame.h"
#include "common/math/philox.h"
#include "common/math/vec.h"

namespace pf {

/// How something changes with a vector, channel by channel: channel c changes by dot(gradient[c], vector).
using RgbGradient = std::array<Vec3f, 3>;
inline constexpr RgbGradient kNoChange{Vec3f{0, 0, 0}, Vec3f{0, 0, 0}, Vec3f{0, 0, 0}};

/// `gradient` applied to `vector`.
[[nodiscard]] inline Rgb change_along(const RgbGradient& gradient, const Vec3f& vector) {
  return {dot(gradient[0], vector), dot(gradient[1], vector), dot(gradient[2], vector)};
}

/// A hemisphere cut into rings x sectors cells of equal projected solid angle, pi / (rings * sectors) each.
/// Both numbers are even: gradients are taken over blocks of 2 x 2 cells.
struct HemisphereGrid {
  std::uint32_t rings = 0;    ///< from the normal to the horizon
  std::uint32_t sectors = 0;  ///< about pi times as many, so that cells are about as wide as they are high

  [[nodiscard]] static HemisphereGrid of_rays(int rays);
  [[nodiscard]] std::uint32_t cells() const { return rings * sectors; }
  /// Direction in cell `ring * sectors + sector`, in the frame of the normal; `u` uniform in the unit square.
  [[nodiscard]] Vec3f direction(std::uint32_t cell, const Vec2f& u) const;
};

/// What gather rays brought, one a cell.
struct HemisphereSamples {
  HemisphereGrid grid;
  std::vector<Rgb> radiance;
  std::vector<float> distance;  ///< metres to the first surface; kInfinity where there is none
};

/// Irradiance and how it changes when the surface turns or moves.
struct IrradianceEstimate {
  Rgb irradiance{0, 0, 0};              ///< W m^-2
  RgbGradient rotation = kNoChange;     ///< per radian: E changes by dot(rotation, n x n') when the normal n becomes n'
  RgbGradient translation = kNoChange;  ///< per metre, in the tangent plane
  float harmonic_distance = 0;          ///< metres; kInfinity under an open sky
};

/// Irradiance from cosine-stratified samples [Ward et al. 1988, (1)] with its rotational and translational
/// gradients [Ward and Heckbert 1992, (2) and the equation after it; Krivanek and Gautron 2009, 3.2]: light
/// moves into or out of a cell over its walls at a rate that the nearer of the surfaces on both sides tells.
///
/// A difference of neighbouring cells has the noise of single samples however many there are, so that the
/// translational gradient's noise does not fall with their number; means over 2 x 2 cells halve it.
[[nodiscard]] IrradianceEstimate estimate_irradiance(const HemisphereSamples& samples, const Frame& frame);

}  // namespace pf
