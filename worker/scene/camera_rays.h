#pragma once

#include "common/math/vec.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// Turns film positions into rays: perspective or orthographic, thin lens for depth of field.
class CameraRays {
 public:
  /// `width`, `height` in pixels. The camera's own aspect ratio is kept: its view is fitted into the image, and what
  /// the image shows beside it is the scene continued.
  CameraRays(const Camera& camera, int width, int height);

  struct Generated {
    Vec3f origin;
    Vec3f direction;  ///< unit
  };
  /// `film` in pixels, (0,0) the top left corner; `lens` uniform in the unit square, unused for a pinhole.
  [[nodiscard]] Generated ray(const Vec2f& film, const Vec2f& lens) const;
  [[nodiscard]] bool has_lens() const { return lens_radius_ > 0.0f; }
  [[nodiscard]] const Vec3f& position() const { return position_; }
  /// Edge of a pixel's footprint on a surface seen head-on after a path of `distance` metres [m].
  [[nodiscard]] float footprint(float distance) const { return footprint_constant_ + footprint_slope_ * distance; }

 private:
  Vec3f position_, right_, up_, forward_;
  float half_width_ = 1, half_height_ = 1;  ///< at distance 1, or the orthographic extents
  float inverse_width_, inverse_height_;
  float lens_radius_ = 0, focus_distance_ = 1;
  float footprint_constant_ = 0, footprint_slope_ = 0;
  bool orthographic_ = false;
};

}  // namespace pf
