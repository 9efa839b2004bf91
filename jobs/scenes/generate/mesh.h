#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Imath/ImathVec.h>

namespace pf::scenes {

/// Geometry is computed in double precision and rounded once, when it is written: the files are then the same
/// bytes on every machine.
using Vec2 = Imath::V2d;
using Vec3 = Imath::V3d;

/// Triangles in metres, counter-clockwise seen from the front.
struct Mesh {
  std::vector<Vec3> positions;
  std::vector<Vec3> normals;  ///< unit, one per vertex; empty: flat shading
  std::vector<Vec3> colors;   ///< linear, multiplies the base colour; empty: white
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// Adds a flat quadrilateral; its corners run counter-clockwise seen from the front. Only for meshes without
/// normals.
void append_quad(Mesh& mesh, const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d);
[[nodiscard]] Mesh quad(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d);

/// Rectangle around `centre` with its front towards `target`; `width` runs horizontally.
[[nodiscard]] Mesh panel(const Vec3& centre, const Vec3& target, double width, double height);

/// Adds an axis-aligned box seen from outside, turned by `degrees` about the vertical through its middle.
void append_box(Mesh& mesh, const Vec3& low, const Vec3& high, double degrees = 0.0);
[[nodiscard]] Mesh box(const Vec3& low, const Vec3& high, double degrees = 0.0);

/// Flat disc of `segments` triangles around `centre`, its front towards the unit vector `normal`.
[[nodiscard]] Mesh disc(const Vec3& centre, const Vec3& normal, double radius, int segments);

/// Unit sphere: an icosahedron whose edges are halved `subdivisions` times, all vertices on the sphere, so
/// that each position is its own normal. 10 * 4^subdivisions + 2 vertices.
[[nodiscard]] Mesh icosphere(int subdivisions);

[[nodiscard]] double radians(double degrees);

}  // namespace pf::scenes
