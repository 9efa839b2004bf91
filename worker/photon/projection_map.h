#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "common/math/vec.h"
#include "worker/scene/lights.h"

namespace pf {

/// Ball that holds a piece of the scene's surfaces whole.
struct SurfaceBall {
  Vec3f center{0, 0, 0};
  float radius = 0;
  bool specular = false;  ///< some of it may reflect or refract sharply
};

/// Balls around all surfaces of a scene: triangles are cut into pieces that are small beside the scene,
/// pieces near each other share a ball.
class SurfaceBalls {
 public:
  explicit SurfaceBalls(const Box3f& bounds);
  void add(const std::array<Vec3f, 3>& corners, bool specular);
  [[nodiscard]] std::vector<SurfaceBall> balls() const;

 private:
  static constexpr int kResolution = 24;  ///< pieces along the longest side of the bounds

  void add_piece(const std::array<Vec3f, 3>& corners, bool specular);

  Box3f bounds_;
  float size_;                                  ///< of a piece [m]
  std::map<std::array<int, 4>, Box3f> pieces_;  ///< by grid cell, and whether specular
};

/// Fewer balls that hold the same surfaces: those in one cell of a grid of this edge [m] become one. None is specular.
[[nodiscard]] std::vector<SurfaceBall> merged_balls(std::span<const SurfaceBall> balls, float edge);

/// Which directions, seen from each light, hold surfaces [Jensen 1996, 3.1; Jensen 2001, 5.2.3]: photons are
/// emitted through On cells only, with their flux scaled by the On cells' share of the light, so that
/// estimates stay unbiased.
///
/// Cells are squares of the random numbers that choose a ray, so that all cells of a light hold the same
/// flux:
///   point and spot lights     of the direction
///   area lights               of the direction, the same for all points of one side: as seen from the ball
///   around the light directional lights        of the place on the disc outside the scene environment
///   likewise, by groups of similar directions
/// A cell is On when any ray through it can meet a ball; it may be On without need, and is never Off where a
/// surface can be hit.
class ProjectionMap {
 public:
  /// What cells must hold to be On: any surface, or one that can start a caustic.
  enum class Target { kAnySurface, kSpecular };
  /// `lights` outlive this; `bounds` as they were given to Lights.
  ProjectionMap(const Lights& lights, const Box3f& bounds, std::span<const SurfaceBall> balls, Target target);

  /// As Lights::emit, through On cells only. Empty also when the light chosen has none.
  [[nodiscard]] std::optional<Lights::EmissionPicked> emit(float u_pick, const Vec2f& u_position,
                                                           const Vec2f& u_direction) const;
  /// A ray through any cell, On or Off: what the cells are tested by.
  struct Probe {
    Lights::EmissionPicked picked;
    bool on = true;
  };
  [[nodiscard]] std::optional<Probe> probe(float u_pick, const Vec2f& u_position, const Vec2f& u_direction) const;
  /// Share of all emitted photons that On cells hold.
  [[nodiscard]] double on_share() const { return on_share_; }
  /// Worth using: without it enough photons would be lost.
  [[nodiscard]] bool sparse() const { return on_share_ < kSparse; }

 private:
  static constexpr double kSparse = 0.8;
  static constexpr std::uint32_t kEdge = 64;        ///< cells along each side of the square of random numbers
  static constexpr std::uint32_t kDiscEdge = 32;    ///< same, of the disc
  static constexpr int kTurns = 48, kHeights = 24;  ///< groups of directions of the environment
  static constexpr std::size_t kMostViews = 64;     ///< the lights after these are On everywhere

  /// On cells of one light: of one side of an area light, of one group of the environment's directions.
  struct View {
    std::uint32_t edge = kEdge;
    std::vector<std::uint32_t> on;  ///< ascending
    bool distant = false;
    Vec3f tangent{1, 0, 0};  ///< distant: the disc's first axis lies as near to this as it can

    [[nodiscard]] double share() const { return static_cast<double>(on.size()) / (edge * edge); }
    [[nodiscard]] bool is_on(const Vec2f& u) const;
    /// Numbers within On cells from numbers within all; some cell is On.
    [[nodiscard]] Vec2f within(const Vec2f& u) const;
    void set(std::uint32_t cells_along, const std::vector<std::uint8_t>& mask);
  };
  /// What a cell or group bounds: all lies within `radius` of `center` (radians on the sphere of directions;
  /// parts of the radius of the disc).
  struct Bound {
    Vec3f center;
    float radius;
  };
  class DiscPicture;

  void find_views(std::uint32_t first, std::uint32_t last, std::span<const SurfaceBall> balls);
  void add_view(float u_pick, std::span<const SurfaceBall> balls);
  [[nodiscard]] View near_view(float u_pick, const Vec3f& center, float radius,
                               std::span<const SurfaceBall> balls) const;
  /// Bounds of the cells of any view's disc, row by row.
  [[nodiscard]] static std::vector<Bound> disc_cells();
  [[nodiscard]] View distant_view(const Bound& directions, std::span<const Bound> cells,
                                  std::span<const SurfaceBall> balls) const;
  [[nodiscard]] double measure_on_share() const;
  /// Which view an emission goes through.
  [[nodiscard]] std::uint64_t key(const Lights::EmissionPicked& picked) const;
  [[nodiscard]] bool of_environment(const Lights::EmissionPicked& picked) const;
  /// Moves the origin of a ray from outside to this place on the view's disc.
  void place(Lights::EmissionPicked& picked, const View& view, const Vec2f& u_position) const;
  [[nodiscard]] static std::size_t group_of(const Vec3f& direction);
  [[nodiscard]] static Bound group(std::size_t index);

  const Lights& lights_;
  Vec3f center_{0, 0, 0};
  float radius_ = 0;
  std::vector<std::uint32_t> area_of_triangle_;
  std::map<std::uint64_t, View> views_;
  double on_share_ = 1.0;
};

}  // namespace pf
