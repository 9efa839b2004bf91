#include "worker/scene/camera_rays.h"

#include "common/math/sampling.h"

namespace pf {

CameraRays::CameraRays(const Camera& camera, int width, int height)
    : inverse_width_(1.0f / static_cast<float>(width)),
      inverse_height_(1.0f / static_cast<float>(height)),
      lens_radius_(camera.lens_radius),
      focus_distance_(camera.focus_distance),
      orthographic_(camera.orthographic) {
  const Matrix44f& m = camera.camera_to_world;
  right_ = normalize(Vec3f{m[0][0], m[0][1], m[0][2]});
  up_ = normalize(Vec3f{m[1][0], m[1][1], m[1][2]});
  forward_ = -normalize(Vec3f{m[2][0], m[2][1], m[2][2]});
  position_ = {m[3][0], m[3][1], m[3][2]};

  const float image_aspect = static_cast<float>(width) / static_cast<float>(height);
  if (orthographic_) {
    half_width_ = camera.xmag;
    half_height_ = camera.ymag;
  } else {
    half_height_ = std::tan(0.5f * camera.yfov);
    half_width_ = half_height_ * (camera.aspect_ratio > 0.0f ? camera.aspect_ratio : image_aspect);
  }
  // Fit the camera's view into the image: the tighter side keeps its extent, the other one grows.
  if (image_aspect > half_width_ / half_height_) {
    half_width_ = half_height_ * image_aspect;
  } else {
    half_height_ = half_width_ / image_aspect;
  }
  const float pixel = 2.0f * half_height_ * inverse_height_;
  (orthographic_ ? footprint_constant_ : footprint_slope_) = pixel;
}

CameraRays::Generated CameraRays::ray(const Vec2f& film, const Vec2f& lens) const {
  const float x = (2.0f * film.x * inverse_width_ - 1.0f) * half_width_;
  const float y = (1.0f - 2.0f * film.y * inverse_height_) * half_height_;
  if (orthographic_) return {position_ + right_ * x + up_ * y, forward_};
  const Vec3f through = right_ * x + up_ * y + forward_;
  if (lens_radius_ <= 0.0f) return {position_, normalize(through)};
  const Vec2f d = sample_disk(lens) * lens_radius_;
  const Vec3f origin = position_ + right_ * d.x + up_ * d.y;
  return {origin, normalize(position_ + through * focus_distance_ - origin)};
}

}  // namespace pf
