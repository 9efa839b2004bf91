#pragma once

#include <memory>
#include <vector>

#include "common/base/result.h"
#include "common/math/vec.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// Light from outside the scene. A latitude-longitude map: direction d has v = acos(d.y)/pi from the top row, and
/// u = 0.5 + atan2(d.x, -d.z)/(2 pi): the image's centre lies along -z, its right half towards +x. Sampled
/// proportionally to luminance times solid angle. A pixel is constant over its rectangle, so that sampling and
/// evaluation agree exactly.
class EnvironmentMap {
 public:
  /// Reads the map. Errors (kInvalidInput): missing, unreadable, NaN/infinite/negative pixels only warn: they are set to
  /// 0 and counted in `warnings`.
  [[nodiscard]] static Result<EnvironmentMap> load(const Environment& e, std::vector<std::string>& warnings);

  /// Radiance [W sr^-1 m^-2] arriving from unit direction `d` (pointing away from the scene).
  [[nodiscard]] Rgb radiance(const Vec3f& d) const;
  /// Density per steradian with which sample() returns `d`.
  [[nodiscard]] float pdf_w(const Vec3f& d) const;
  struct Sample { Vec3f direction; Rgb radiance; float pdf_w; };
  [[nodiscard]] Sample sample(const Vec2f& u) const;
  /// Integral of radiance over the sphere of directions [W m^-2]: flux through a disc = this * disc area.
  [[nodiscard]] Rgb total() const;
  [[nodiscard]] bool present() const;

 private:
  // The owner of this file completes it.
};

}  // namespace pf
