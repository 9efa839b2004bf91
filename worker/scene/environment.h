#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/math/distribution.h"
#include "common/math/vec.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// Light from outside the scene: constant, or a latitude-longitude map: direction d has v = acos(d.y)/pi from
/// the top row, and u = 0.5 + atan2(d.x, -d.z)/(2 pi): the image's centre lies along -z, its right half
/// towards +x. Sampled proportionally to luminance times solid angle. A pixel is constant over its rectangle,
/// so that sampling and evaluation agree exactly.
class EnvironmentMap {
 public:
  /// Reads the map (.hdr or .exr, told by their content; first part, largest level). `e.radiance` scales it,
  /// channel by channel; without a file it is the constant radiance itself. Errors (kInvalidInput): missing,
  /// unreadable, too large. Pixels that are negative, NaN, infinite or above 1e18 only warn: they become 0
  /// and are counted in `warnings`.
  [[nodiscard]] static Result<EnvironmentMap> load(const Environment& e, std::vector<std::string>& warnings);

  /// Radiance [W sr^-1 m^-2] arriving from unit direction `d` (pointing away from the scene).
  [[nodiscard]] Rgb radiance(const Vec3f& d) const;
  /// Density per steradian with which sample() returns `d`.
  [[nodiscard]] float pdf_w(const Vec3f& d) const;
  struct Sample {
    Vec3f direction;
    Rgb radiance;
    float pdf_w;
  };
  [[nodiscard]] Sample sample(const Vec2f& u) const;
  /// Integral of radiance over the sphere of directions [W m^-2]: flux through a disc = this * disc area.
  [[nodiscard]] Rgb total() const;
  /// False when no direction brings any light.
  [[nodiscard]] bool present() const;

 private:
  struct Pixel {
    std::size_t x = 0, y = 0;
  };

  [[nodiscard]] Pixel pixel_at(const Vec3f& d) const;
  [[nodiscard]] std::size_t index(const Pixel& p) const { return p.y * width_ + p.x; }
  /// Direction of a position within a pixel, uniform in solid angle for uniform `u`.
  [[nodiscard]] Vec3f direction_in(const Pixel& p, const Vec2f& u) const;
  [[nodiscard]] float pdf_of(const Rgb& radiance) const { return luminance(radiance) * inverse_luminance_; }
  void prepare();

  std::size_t width_ = 0, height_ = 0;  ///< 0: no map, the same radiance everywhere
  std::vector<Rgb> pixels_;
  Rgb constant_{0, 0, 0};
  Rgb total_{0, 0, 0};
  float inverse_luminance_ = 0;  ///< 1 / integral of luminance over the sphere
  Distribution2D distribution_;
  std::vector<double> row_borders_;  ///< sin^2(theta/2) at the border above each row, and 1 at the end
};

}  // namespace pf
