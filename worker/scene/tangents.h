#pragma once

#include <vector>

#include "common/math/vec.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// Gives every corner of every triangle its own vertex and the triangle's normal: flat shading, said with
/// normals.
void make_flat(Mesh& mesh);

/// Generates Mesh::tangents for a normal map that reads `uv` (one per vertex, transformed as the material
/// says), in the manner of MikkTSpace [Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited", 4.1]:
/// corners of equal position, normal and uv share a tangent frame, unless their triangles are mirrored in uv
/// against each other; the frame is the mean of the triangles' tangents in the plane of the normal, weighted
/// by the corner's angle. Vertices whose corners need different frames are split. glTF's v runs downwards:
/// the bitangent is cross(n, t) * w and points to smaller v. `mesh` must have normals. Deviation:
/// mikktspace.c also separates fans that touch in a vertex only.
void generate_tangents(Mesh& mesh, const std::vector<Vec2f>& uv);

/// `v` at unit length, computed in double precision so that no length between 1e-45 and 1e38 spoils it; zero
/// where `v` is zero or not finite.
[[nodiscard]] Vec3f unit_or_zero(const Vec3f& v);

/// A unit vector perpendicular to unit `normal`, with sign +1.
[[nodiscard]] Vec4f any_tangent(const Vec3f& normal);

}  // namespace pf
