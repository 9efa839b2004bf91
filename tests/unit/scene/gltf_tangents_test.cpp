#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "worker/scene/tangents.h"

namespace pf {
namespace {

/// Two triangles on z = 0 that share an edge; uv of the second mirrored if asked for.
Mesh quad_mesh(bool mirrored) {
  Mesh m;
  m.positions = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  m.normals.assign(4, Vec3f(0, 0, 1));
  // v runs downwards: +y on the surface is -v. Mirrored, u goes back to 0 across the shared diagonal.
  m.uv[0] = mirrored ? std::vector<Vec2f>{{0, 1}, {1, 1}, {0, 0}, {1, 1}}
                     : std::vector<Vec2f>{{0, 1}, {1, 1}, {1, 0}, {0, 0}};
  m.triangles = {{0, 1, 2}, {0, 2, 3}};
  return m;
}

Vec3f xyz(const Vec4f& v) { return {v.x, v.y, v.z}; }

TEST(Tangents, FollowGrowingUAndTheBitangentPointsUpTheTexture) {
  Mesh m = quad_mesh(false);
  generate_tangents(m, m.uv[0]);
  ASSERT_EQ(m.tangents.size(), 4u);
  for (const Vec4f& t : m.tangents) {
    EXPECT_LT((xyz(t) - Vec3f(1, 0, 0)).length(), 1e-6f);
    // cross(n, t) * w = +y, towards smaller v.
    EXPECT_EQ(t.w, 1.0f);
  }
}

TEST(Tangents, MirroredTrianglesGetVerticesOfTheirOwn) {
  Mesh m = quad_mesh(true);
  m.colors.assign(4, Vec4f(1, 1, 1, 1));
  generate_tangents(m, m.uv[0]);
  EXPECT_EQ(m.positions.size(), 6u);  // the two vertices of the shared edge are split
  EXPECT_EQ(m.normals.size(), 6u);
  EXPECT_EQ(m.uv[0].size(), 6u);
  EXPECT_EQ(m.colors.size(), 6u);
  ASSERT_EQ(m.tangents.size(), 6u);
  float signs[2];
  for (std::size_t f = 0; f < 2; ++f) {
    signs[f] = m.tangents[m.triangles[f][0]].w;
    for (const std::uint32_t i : m.triangles[f]) EXPECT_EQ(m.tangents[i].w, signs[f]);
  }
  EXPECT_EQ(signs[0], -signs[1]);
}

TEST(Tangents, UnindexedTrianglesShareFramesWhereTheyMeet) {
  // A roof: two faces that meet in an edge with common normals and uv, every corner a vertex of its own.
  const Vec3f n(0, 0, 1);
  Mesh m;
  m.positions = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {1, 0, 0}, {2, 0, -1}, {1, 1, 0}};
  m.normals.assign(6, n);
  m.uv[0] = {{0, 1}, {1, 1}, {1, 0}, {1, 1}, {2, 1}, {1, 0}};
  m.triangles = {{0, 1, 2}, {3, 4, 5}};
  generate_tangents(m, m.uv[0]);
  EXPECT_EQ(m.tangents[1], m.tangents[3]);
  EXPECT_EQ(m.tangents[2], m.tangents[5]);
}

TEST(Tangents, WithoutAreaInUvAreStillUnitAndPerpendicular) {
  Mesh m = quad_mesh(false);
  for (Vec2f& x : m.uv[0]) x = Vec2f(0.5f, 0.5f);
  generate_tangents(m, m.uv[0]);
  for (std::size_t i = 0; i < m.tangents.size(); ++i) {
    EXPECT_NEAR(length(xyz(m.tangents[i])), 1.0f, 1e-5f);
    EXPECT_NEAR(dot(xyz(m.tangents[i]), m.normals[i]), 0.0f, 1e-5f);
  }
}

TEST(Tangents, MakeFlatGivesEveryTriangleItsNormal) {
  Mesh m = quad_mesh(false);
  m.normals.clear();
  m.positions[3] = Vec3f(0, 1, 1);
  make_flat(m);
  ASSERT_EQ(m.positions.size(), 6u);
  EXPECT_LT((m.normals[0] - Vec3f(0, 0, 1)).length(), 1e-6f);
  for (std::size_t i = 3; i < 6; ++i) {
    EXPECT_EQ(m.normals[i], m.normals[3]);
    EXPECT_NEAR(length(m.normals[i]), 1.0f, 1e-6f);
  }
  EXPECT_GT((m.normals[3] - m.normals[0]).length(), 0.1f);
}

}  // namespace
}  // namespace pf
