#pragma once

#include <utility>
#include <vector>

#include "jobs/scenes/generate/mesh.h"

namespace pf::scenes {

/// A plane curve of lines, arcs and cubic Bezier segments, sampled with its exact normals; turned about the y
/// axis it is a glass, a bottle or a ring. x is the distance from the axis, y the height. The front lies to
/// the right of the direction of travel: an outer wall is drawn upwards, an inner wall downwards.
class Profile {
 public:
  struct Sample {
    Vec2 point;
    Vec2 normal;  ///< unit
  };

  explicit Profile(const Vec2& start) : pen_(start) {}
  explicit Profile(std::vector<Sample> samples) : samples_(std::move(samples)), pen_(samples_.back().point) {}

  Profile& line_to(const Vec2& end, int segments = 1);
  /// Turns the pen about `centre` by `degrees`, counter-clockwise when positive.
  Profile& arc(const Vec2& centre, double degrees, int segments);
  Profile& curve_to(const Vec2& control1, const Vec2& control2, const Vec2& end, int segments);
  /// Goes back along samples [first, last], `thickness` behind their front: the other side of a wall of even
  /// thickness.
  Profile& parallel_back(std::size_t first, std::size_t last, double thickness);

  [[nodiscard]] const Vec2& pen() const { return pen_; }
  [[nodiscard]] const std::vector<Sample>& samples() const { return samples_; }

 private:
  void add(const Vec2& point, const Vec2& tangent);
  void add_sample(const Sample& sample);

  std::vector<Sample> samples_;
  Vec2 pen_;
};

/// Surface of revolution about the y axis: closed when the profile starts and ends on the axis, or ends where
/// it started. Two samples at one point with different normals make a sharp edge.
[[nodiscard]] Mesh lathe(const Profile& profile, int segments);

/// The samples of an inner wall (drawn downwards, ending on the axis) up to the height `level`, turned into
/// the outer side of the liquid that it holds: drawn upwards from the axis, pushed `overlap` metres into the
/// wall, so that the liquid's surface lies inside the glass and no film of air is left between; closed by a
/// surface with a meniscus of height `rise`.
[[nodiscard]] Profile liquid_in(const std::vector<Profile::Sample>& inner_wall, double level, double overlap,
                                double rise);

}  // namespace pf::scenes
