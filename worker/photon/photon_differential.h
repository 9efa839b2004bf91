#pragma once

#include <array>

#include "common/math/vec.h"
#include "worker/photon/splat_kernel.h"

namespace pf {

/// How a surface's shading normal changes along its tangents: the shape of a curved surface around a point.
struct SurfaceShape {
  Vec3f tangent_x{0, 0, 0}, tangent_y{0, 0, 0};      ///< orthonormal, in the tangent plane
  Vec3f normal_by_x{0, 0, 0}, normal_by_y{0, 0, 0};  ///< [1/m]; zero: flat

  [[nodiscard]] Vec3f normal_change(const Vec3f& displacement) const {
    return normal_by_x * dot(displacement, tangent_x) + normal_by_y * dot(displacement, tangent_y);
  }
};

/// How the photon paths around one path lie to it: derivatives of its ray, of origin and direction together, by the
/// random numbers that made the path. Two paths whose numbers differ by a step of 1/sqrt(N) are neighbours among N.
///
/// Ray differentials [Igehy 1999] carried along photons [Schjoth et al. 2007; Frisvad et al. 2014]. The papers carry
/// two; here are four, because a lamp with an extent has two dimensions of position and two of direction. As they are
/// independent, the squared spreads of the four add up: a 4 x 4 covariance of (position, direction), of which these
/// vectors are a root. The area that they span is one over the density of paths across the ray: the density of the
/// whole path [Herzog et al. 2007].
class PhotonDifferential {
 public:
  static constexpr std::size_t kAxes = 4;

  PhotonDifferential() = default;
  /// Paths that start around a point, along unit `direction`: `pdf_a` [1/m^2] over the plane across `plane_normal`
  /// (that of a lamp's surface, or `direction` itself), `pdf_w` [1/sr]; infinite where that does not vary.
  [[nodiscard]] static PhotonDifferential emitted(const Vec3f& direction, const Vec3f& plane_normal, float pdf_a,
                                                  float pdf_w);

  /// After `distance` metres.
  void advance(float distance);
  /// After a mirror-like reflection into `to` about unit `normal`, at a surface of geometric normal `ng`
  /// [Igehy 1999, (10), (14), (15)]. Normals on either side.
  void reflect(const Vec3f& ng, const Vec3f& normal, const SurfaceShape& shape, const Vec3f& to);
  /// After a refraction into `to`, from index of refraction `eta_i` to `eta_t` [Igehy 1999, (16), (17)].
  void refract(const Vec3f& ng, const Vec3f& normal, const SurfaceShape& shape, float eta_i, float eta_t,
               const Vec3f& to);
  /// After light went on along `to` with a new direction that the old one says nothing about the change of: mirrored or
  /// refracted as by a plane, spreads turned along. What stands for reflect() and refract() when differentials are off.
  void turn(const Vec3f& to);
  /// After a diffuse bounce into `to`: places stay apart as they lie on the surface; directions are independent of
  /// them.
  void bounce(const Vec3f& ng, const Vec3f& to, float pdf_w);
  /// Adds an independent spread of direction of density `pdf_w`, as a rough lobe does around a mirror's or a lens's
  /// direction.
  void roughen(float pdf_w);

  [[nodiscard]] const Vec3f& ray_direction() const { return ray_; }
  /// Derivative `k` of the origin, across the ray [m], and of the direction [rad].
  [[nodiscard]] const Vec3f& position(std::size_t k) const { return position_[k]; }
  [[nodiscard]] const Vec3f& direction(std::size_t k) const { return direction_[k]; }

  /// Squared spreads across the ray, along `axis_x` and `axis_y`: at_start + t linear + t^2 quadratic at distance t
  /// [m^2].
  struct Along {
    Spread at_start, linear, quadratic;
  };
  [[nodiscard]] Along along(const Vec3f& axis_x, const Vec3f& axis_y) const;

 private:
  /// Moves the origins onto the surface, along their rays [Igehy 1999, (10)].
  void meet(const Vec3f& ng);
  /// The origins seen across the new direction.
  void leave(const Vec3f& to);

  Vec3f ray_{0, 0, 1};
  std::array<Vec3f, kAxes> position_{};
  std::array<Vec3f, kAxes> direction_{};
};

}  // namespace pf
