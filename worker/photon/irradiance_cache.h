#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/math/vec.h"
#include "worker/photon/irradiance_hemisphere.h"

namespace pf {

/// Indirect irradiance at a point, and where around it the value may be used.
struct IrradianceRecord {
  Vec3f position{0, 0, 0};
  Vec3f normal{0, 0, 1};  ///< unit, of shading, on the side that gathers
  Vec3f geometric_normal{0, 0, 1};
  float extent = 0;         ///< of the triangle below (SurfacePoint::extent)
  Rgb irradiance{0, 0, 0};  ///< W m^-2
  RgbGradient rotation = kNoChange, translation = kNoChange;
  float radius = 0;  ///< R of [Ward 1988]: the value's error is about distance / R
  float least = 0,
        most = 0;          ///< bounds of the radius, from the spacing in pixels where the record was made [m]
  std::uint32_t id = 0;    ///< names the random numbers of its gather rays
  std::uint32_t rays = 1;  ///< asked of its hemisphere (HemisphereGrid::of_rays)

  [[nodiscard]] HemisphereGrid grid() const { return HemisphereGrid::of_rays(static_cast<int>(rays)); }
};

/// Sets irradiance, gradients and radius: the harmonic mean distance to what the gather rays met, or less
/// where the irradiance changes faster than that says [Krivanek and Gautron 2009, 3.3.2], within the record's
/// bounds. Below the lower bound the gradient shrinks along, or it would extrapolate too far.
void set_estimate(IrradianceRecord& record, const IrradianceEstimate& estimate);

/// Irradiance records in an octree, read by interpolation.
///
/// Ward, Rubinstein, Clear 1988, "A Ray Tracing Solution for Diffuse Interreflection": weights from the
/// split-sphere model; Ward and Heckbert 1992, "Irradiance Gradients": extrapolation; Krivanek, Bouatouch,
/// Pattanaik, Zara 2006, "Making Radiance and Irradiance Caching Practical": neighbour clamping. A record
/// counts where its error estimate stays below `error` (a), with a weight that falls evenly to 0 there
/// [Tabellion and Lamorlette 2004, "An Approximate Global Illumination System for Computer Generated Films"] and
/// in proportion to its rays, as its noise asks: Ward's 1/estimate lets the nearest record's noise through. Bias: the
/// interpolated value differs by about `error` times; details smaller than the lower bound of the radii are lost.
class IrradianceCache {
 public:
  IrradianceCache(const Box3f& bounds, float error);

  /// Adds a record. No radius may then differ from a neighbour's by more than their distance: the larger one
  /// shrinks.
  void insert(const IrradianceRecord& record);
  /// Weighted mean of what the records say of this point; empty where none reaches. `tightness` in (0, 1]
  /// scales the accepted error: what builds the cache asks for more than what reads it, so that readers find
  /// records on every side.
  [[nodiscard]] std::optional<Rgb> interpolate(const Vec3f& position, const Vec3f& normal,
                                               float tightness = 1.0f) const;
  /// Weight of one record of one ray: 1 at the record itself, 0 where it does not count.
  [[nodiscard]] static float weight(const IrradianceRecord& record, const Vec3f& position, const Vec3f& normal,
                                    float error);

  [[nodiscard]] const std::vector<IrradianceRecord>& records() const { return records_; }
  [[nodiscard]] float error() const { return error_; }
  /// Forgets all records and takes these as they are, radii included: what insert() made of them before.
  void assign(std::vector<IrradianceRecord> records);

 private:
  static constexpr std::uint32_t kNone = ~0u;
  struct Node {
    std::array<std::uint32_t, 8> children;
    std::vector<std::uint32_t> records;
    Node() { children.fill(kNone); }
  };
  /// A cube of the octree on the way down.
  struct Cell {
    std::uint32_t node = 0;
    Vec3f centre;
    float edge = 0;
    int depth = 0;
  };
  [[nodiscard]] Cell root() const { return {0, centre_, edge_, 0}; }
  [[nodiscard]] static Cell child(const Cell& cell, unsigned octant, std::uint32_t node);
  /// Whether a ball reaches into an octant; outer cells have no outer border, so that no point is outside.
  [[nodiscard]] static bool reaches(const Cell& cell, unsigned octant, const Vec3f& position, float radius);
  void place(std::uint32_t index, float radius);
  void clamp_to_neighbours(IrradianceRecord& record);

  std::vector<IrradianceRecord> records_;
  std::vector<Node> nodes_;
  Vec3f centre_;
  float edge_;
  float error_;
};

}  // namespace pf
