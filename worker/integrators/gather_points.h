#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "common/film/pass_order.h"
#include "common/spec/job_spec.h"
#include "worker/integrators/direct_light.h"
#include "worker/integrators/eye.h"
#include "worker/integrators/gather_rays.h"

namespace pf {

/// Indirect irradiance at a point, gathered over its hemisphere.
struct GatherPoint {
  bool valid = false;     ///< the surface has a Lambert reflector to gather for
  bool gathered = false;  ///< the fields after ng are known
  Vec3f position{0, 0, 0};
  Vec3f ns{0, 0, 1}, ng{0, 0, 1};
  Rgb irradiance{0, 0, 0};     ///< W m^-2
  float error = 0;             ///< standard error of its luminance, of the random choice of rays
  float distance = kInfinity;  ///< harmonic mean of the distances to what the rays met [m]: how near other surfaces are
};

/// Gathers irradiance by rays.
///
/// Part of them are stratified over the cosine-weighted hemisphere; the others are drawn from a histogram of
/// the directions that the nearest indirect photons came from [Jensen 1995, "Importance Driven Path Tracing
/// using the Photon Map"], and both are joined by the balance heuristic [Veach 1997, 9.2.2]: without bias
/// given what the rays bring, whatever the histogram.
class HemisphereGather {
 public:
  HemisphereGather(const MapGather& gather, const JobSpec& spec);
  [[nodiscard]] GatherPoint at(const Vertex& vertex, const MediumStack& media, int rays, PathRng& rng,
                               TileFigures& figures) const;

 private:
  /// Cells of equal cosine measure: squared sine along the rows, angle around the normal along the columns.
  static constexpr int kRows = 6, kColumns = 12;
  static constexpr std::size_t kCells = std::size_t{kRows} * kColumns;

  struct Histogram;
  [[nodiscard]] bool fill(const Vertex& vertex, Histogram& histogram) const;

  const MapGather& gather_;
  float importance_;
  std::uint32_t nearest_;
};

/// Gather points of an image, placed adaptively on a lattice of its pixels, tile by tile.
///
/// Squares of kCoarsest pixels are cut in four, down to kFinest, while the irradiance at their corners may not be
/// interpolated: where corners lie on different surfaces, which rays through them tell before anything is gathered,
/// where other surfaces are near (the bound of [Ward 1988] for moving and turning away from a point, half of the
/// square's diagonal at most, exceeds `error`), or where corners differ by more than `error` allows beyond their noise.
/// A corner's point depends on its place in the image alone, so that tiles agree at their borders, whoever renders
/// them.
class GatherPoints {
 public:
  static constexpr int kCoarsest = 16,
                       kFinest = 2;  ///< points of single pixels would have more rays than their samples

  GatherPoints(const Scene& scene, const Eye& eye, const HemisphereGather& gather, const JobSpec& spec);

  /// Places the points of a part, unless that is done. A part starts at a multiple of kCoarsest.
  void place(const ImagePart& part);
  /// Irradiance at the vertex seen by a pixel of a part that was placed, interpolated; false where it must be
  /// gathered.
  [[nodiscard]] bool interpolate(int x, int y, const Vertex& vertex, Rgb& irradiance) const;
  /// Whether the pixel's corner holds a point.
  [[nodiscard]] bool marked(int x, int y) const;
  /// Rays shot and faults met in placing the points of the part that starts at this pixel; none at its other
  /// pixels.
  [[nodiscard]] TileFigures figures_at(int x, int y) const;

 private:
  struct Part {
    bool placed = false;
    int x0 = 0, y0 = 0, columns = 0;   ///< columns: of the lattice, corners on both borders
    std::vector<std::int32_t> corner;  ///< number of the point, or -1
    std::vector<GatherPoint> points;
    std::vector<std::uint8_t> square;  ///< per pixel: edge of the square it lies in, 0: not to be interpolated
    TileFigures figures;
    [[nodiscard]] std::size_t index(int x, int y) const {
      return static_cast<std::size_t>(y - y0) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(x - x0);
    }
    [[nodiscard]] const GatherPoint& at(int x, int y) const {
      return points[static_cast<std::size_t>(corner[index(x, y)])];
    }
    void fill(const std::pair<int, int>& first, int edge) {
      for (int py = first.second; py < first.second + edge; ++py) {
        for (int px = first.first; px < first.first + edge; ++px)
          square[index(px, py)] = static_cast<std::uint8_t>(edge);
      }
    }
    [[nodiscard]] std::array<const GatherPoint*, 4> corners_of(int x, int y, int edge) const {
      return {&at(x, y), &at(x + edge, y), &at(x, y + edge), &at(x + edge, y + edge)};
    }
  };

  [[nodiscard]] const Part& part_of(int x, int y) const;
  /// A square of the lattice by its first pixel.
  using Square = std::pair<int, int>;
  /// What the pinhole sees through a corner, where that is a Lambert reflector.
  [[nodiscard]] std::optional<Vertex> look(int x, int y, TileFigures& figures) const;
  /// Finds what lies behind the corners of squares that were not looked at yet.
  void look_at(Part& part, const std::vector<Square>& squares, int edge) const;
  /// Gathers at the corners of squares where that has not been done yet.
  void gather_at(Part& part, const std::vector<Square>& squares, int edge) const;
  [[nodiscard]] static bool on_one_surface(const Part& part, const Square& square, int edge);
  [[nodiscard]] bool interpolates(const Part& part, const Square& square, int edge) const;
  /// Of squares that may not be interpolated, as far as they show a surface at all.
  [[nodiscard]] static std::vector<Square> quarters(const Part& part, const std::vector<Square>& squares, int edge,
                                                    const ImagePart& within);

  const Scene& scene_;
  const Eye& eye_;
  const HemisphereGather& gather_;
  int rays_;
  float error_;
  std::uint64_t seed_;
  int edge_, columns_;  ///< of the parts
  std::mutex placing_;
  std::vector<Part> parts_;
};

}  // namespace pf
