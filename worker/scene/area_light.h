#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/math/vec.h"
#include "worker/scene/emissive_triangle.h"

namespace pf {

/// What light sampling chooses among: an emissive triangle, or two that share an edge, lie in one plane,
/// shine alike and make a parallelogram. The latter are one emitter, sampled without a seam.
class AreaLight {
 public:
  /// One triangle.
  AreaLight(const EmissiveTriangle& triangle, std::uint32_t index);

  /// The emitters of `triangles`; degenerate and black ones are left out. Rectangles are paired before other
  /// parallelograms, then in order of index: the result depends on the input alone.
  [[nodiscard]] static std::vector<AreaLight> group(std::span<const EmissiveTriangle> triangles);

  /// A point of the emitter: position, and where it lies in the caller's triangles.
  struct Point {
    Vec3f position;
    std::uint32_t triangle = 0;
    Vec2f barycentric;  ///< weights of that triangle's second and third corner
  };
  struct Sample {
    Point point;
    Vec3f wi;  ///< unit, from the receiver to the point
    float distance = 0;
    float pdf_w = 0;  ///< per steradian, given this emitter
  };

  /// Whether light of this emitter leaves towards `p`: on the front side, or either side of a two-sided one.
  [[nodiscard]] bool faces(const Vec3f& p) const;
  /// A point as seen from `p`: uniform in solid angle where that is large, uniform in area elsewhere. Empty
  /// where no light can leave towards `p`.
  [[nodiscard]] std::optional<Sample> sample(const Vec3f& p, const Vec2f& u) const;
  /// Density per steradian with which sample(p) returns the point `q` of the emitter.
  [[nodiscard]] float pdf_w(const Vec3f& p, const Vec3f& q) const;
  /// Uniform by area.
  [[nodiscard]] Point sample_uniform(const Vec2f& u) const;
  /// The point origin + s edge_u + t edge_v.
  [[nodiscard]] Point point_at(float s, float t) const;
  [[nodiscard]] const Vec3f& origin() const { return origin_; }
  [[nodiscard]] const Vec3f& edge_u() const { return edge_u_; }
  [[nodiscard]] const Vec3f& edge_v() const { return edge_v_; }

  [[nodiscard]] float area() const { return area_; }
  [[nodiscard]] const Vec3f& ng() const { return ng_; }
  [[nodiscard]] const Rgb& radiance() const { return radiance_; }
  [[nodiscard]] bool two_sided() const { return two_sided_; }
  [[nodiscard]] float extent() const { return extent_; }  ///< largest absolute coordinate of the corners
  [[nodiscard]] Box3f box() const;
  /// Flux [W] for the mean radiance: pi L A, for each side that shines.
  [[nodiscard]] Rgb flux() const { return radiance_ * (kPi * area_ * (two_sided_ ? 2.0f : 1.0f)); }
  /// Triangles that this emitter is made of: one or two.
  [[nodiscard]] std::span<const std::uint32_t> triangles() const { return {triangles_.data(), count_}; }
  [[nodiscard]] bool is_rectangle() const { return rectangle_; }

 private:
  /// A triangle seen from the corner that both parts of a parallelogram do not share: which of the weights
  /// (corner, along u, along v) belong to its second and third corner.
  struct Roles {
    std::uint8_t second = 1, third = 2;
  };

  struct SharedEdge;
  AreaLight(const EmissiveTriangle& like, const Vec3f& origin, const Vec3f& edge_u, const Vec3f& edge_v, int count);
  [[nodiscard]] static std::vector<SharedEdge> shared_edges(std::span<const EmissiveTriangle> triangles,
                                                            const std::vector<bool>& usable);
  [[nodiscard]] static std::optional<AreaLight> pair(std::span<const EmissiveTriangle> triangles,
                                                     const SharedEdge& edge);
  [[nodiscard]] double large_solid_angle(const Vec3f& p) const;
  [[nodiscard]] Vec2f sample_solid_angle(const Vec3f& p, const Vec2f& u) const;

  Vec3f origin_, edge_u_, edge_v_, ng_;
  Vec3f center_;
  float radius_ = 0;
  float area_ = 0;
  float extent_ = 0;
  Rgb radiance_;
  bool two_sided_ = false;
  bool rectangle_ = false;
  std::uint8_t count_ = 1;
  std::array<std::uint32_t, 2> triangles_{};
  std::array<Roles, 2> roles_{};
};

}  // namespace pf
