// One test for each form that an accessor can have.
#include <array>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/unit/scene/gltf_builder.h"

namespace pf {
namespace {

using testing::PrintToString;

/// Loads a builder's file and returns its only mesh.
Mesh only_mesh(const GltfBuilder& b) {
  auto scene = b.load();
  EXPECT_TRUE(scene.has_value()) << (scene ? "" : scene.error().message);
  if (!scene || scene->meshes.size() != 1) {
    ADD_FAILURE() << "expected one mesh";
    return {};
  }
  return scene->meshes[0];
}

TEST(GltfAccessor, UnindexedTriangleTakesItsVerticesInOrder) {
  GltfBuilder b;
  b.primitive({{"POSITION", b.floats(kTriangle, "VEC3", 3)}});
  const Mesh mesh = only_mesh(b);
  ASSERT_EQ(mesh.triangles.size(), 1u);
  EXPECT_EQ(mesh.triangles[0], (std::array<std::uint32_t, 3>{0, 1, 2}));
  EXPECT_EQ(mesh.positions[1], Vec3f(1, 0, 0));
  EXPECT_TRUE(mesh.normals.empty());
}

TEST(GltfAccessor, IndicesMayHaveOneTwoOrFourBytes) {
  for (const int type : {5121, 5123, 5125}) {
    GltfBuilder b;
    const int position = b.floats(kTriangle, "VEC3", 3);
    const int view = type == 5121   ? b.view(std::vector<std::uint8_t>{2, 0, 1})
                     : type == 5123 ? b.view(std::vector<std::uint16_t>{2, 0, 1})
                                    : b.view(std::vector<std::uint32_t>{2, 0, 1});
    const int indices = b.accessor(view, type, "SCALAR", 3);
    b.primitive({{"POSITION", position}})["indices"] = indices;
    EXPECT_EQ(only_mesh(b).triangles.at(0), (std::array<std::uint32_t, 3>{2, 0, 1})) << type;
  }
}

TEST(GltfAccessor, StripsAndFansBecomeTrianglesOfOneWinding) {
  const std::vector<float> square = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 2, 0};
  using Triangles = std::vector<std::array<std::uint32_t, 3>>;
  GltfBuilder strip;
  strip.primitive({{"POSITION", strip.floats(square, "VEC3", 3)}})["mode"] = 5;
  const Mesh mesh = only_mesh(strip);
  EXPECT_EQ(mesh.triangles, (Triangles{{0, 1, 2}, {1, 3, 2}, {2, 3, 4}}));
  for (const auto& t : mesh.triangles) {
    EXPECT_GT(cross(mesh.positions[t[1]] - mesh.positions[t[0]], mesh.positions[t[2]] - mesh.positions[t[0]]).z, 0.0f);
  }
  GltfBuilder fan;
  fan.primitive({{"POSITION", fan.floats({0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0}, "VEC3", 3)}})["mode"] = 6;
  EXPECT_EQ(only_mesh(fan).triangles, (Triangles{{1, 2, 0}, {2, 3, 0}}));
}

TEST(GltfAccessor, ByteStrideSeparatesInterleavedAttributes) {
  GltfBuilder b;
  // position, normal, position, ...
  const int view = b.view(std::vector<float>{0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 1}, 24);
  const int position = b.accessor(view, 5126, "VEC3", 3);
  const int normal = b.accessor(view, 5126, "VEC3", 3, {{"byteOffset", 12}});
  b.primitive({{"POSITION", position}, {"NORMAL", normal}});
  const Mesh mesh = only_mesh(b);
  EXPECT_EQ(mesh.positions[2], Vec3f(0, 1, 0));
  EXPECT_EQ(mesh.normals[2], Vec3f(0, 0, 1));
}

TEST(GltfAccessor, NormalizedIntegersBecomeFractions) {
  GltfBuilder b;
  const int position = b.floats(kTriangle, "VEC3", 3);
  const int uv = b.accessor(b.view(std::vector<std::uint16_t>{0, 65535, 32768, 0, 65535, 65535}), 5123, "VEC2", 3,
                            {{"normalized", true}});
  const int color = b.accessor(b.view(std::vector<std::uint8_t>{255, 0, 51, 0, 0, 255, 0, 0, 0, 0, 255, 0}, 4), 5121,
                               "VEC3", 3, {{"normalized", true}});
  b.primitive({{"POSITION", position}, {"TEXCOORD_0", uv}, {"COLOR_0", color}});
  const Mesh mesh = only_mesh(b);
  EXPECT_EQ(mesh.uv[0][0], Vec2f(0, 1));
  EXPECT_FLOAT_EQ(mesh.uv[0][1].x, 32768.0f / 65535.0f);
  EXPECT_NEAR((mesh.colors[0] - Vec4f(1, 0, 0.2f, 1)).length(), 0.0f, 1e-6f);  // RGB gets an alpha of 1
}

TEST(GltfAccessor, ColorsMayBeFloatsWithAlpha) {
  GltfBuilder b;
  const int position = b.floats(kTriangle, "VEC3", 3);
  b.primitive({{"POSITION", position}, {"COLOR_0", b.floats({1, 0, 0, 0.5f, 0, 1, 0, 1, 0, 0, 1, 0}, "VEC4", 4)}});
  EXPECT_EQ(only_mesh(b).colors[0], Vec4f(1, 0, 0, 0.5f));
}

TEST(GltfAccessor, SparseValuesReplaceThoseOfTheBufferView) {
  GltfBuilder b;
  const int base = b.view(kTriangle);
  const int indices = b.view(std::vector<std::uint16_t>{1});
  const int values = b.view(std::vector<float>{7, 8, 9});
  const nlohmann::json sparse = {{"count", 1},
                                 {"indices", {{"bufferView", indices}, {"componentType", 5123}}},
                                 {"values", {{"bufferView", values}}}};
  b.primitive({{"POSITION", b.accessor(base, 5126, "VEC3", 3, {{"sparse", sparse}})}});
  const Mesh mesh = only_mesh(b);
  EXPECT_EQ(mesh.positions[1], Vec3f(7, 8, 9));
  EXPECT_EQ(mesh.positions[2], Vec3f(0, 1, 0));
}

TEST(GltfAccessor, SparseValuesWithoutBufferViewStandAmongZeros) {
  GltfBuilder b;
  const int indices = b.view(std::vector<std::uint8_t>{1, 2});
  const int values = b.view(std::vector<float>{1, 0, 0, 0, 1, 0});
  const nlohmann::json sparse = {{"count", 2},
                                 {"indices", {{"bufferView", indices}, {"componentType", 5121}}},
                                 {"values", {{"bufferView", values}}}};
  b.primitive({{"POSITION", b.accessor(-1, 5126, "VEC3", 3, {{"sparse", sparse}})}});
  const Mesh mesh = only_mesh(b);
  EXPECT_EQ(mesh.positions[0], Vec3f(0, 0, 0));
  EXPECT_EQ(mesh.positions[2], Vec3f(0, 1, 0));
}

TEST(GltfAccessor, QuantizedPositionsKeepTheirValueUnlessNormalized) {
  for (const bool normalized : {false, true}) {
    GltfBuilder b;
    b.use("KHR_mesh_quantization");
    const int view = b.view(std::vector<std::int16_t>{0, 0, 0, 0, 32767, 0, 0, 0, 0, -32768, 0, 0}, 8);
    b.primitive({{"POSITION", b.accessor(view, 5122, "VEC3", 3, {{"normalized", normalized}})}});
    const Mesh mesh = only_mesh(b);
    EXPECT_EQ(mesh.positions[1], Vec3f(normalized ? 1.0f : 32767.0f, 0, 0));
    EXPECT_EQ(mesh.positions[2], Vec3f(0, normalized ? -1.0f : -32768.0f, 0));
  }
}

TEST(GltfAccessor, FourUvSetsAreKept) {
  GltfBuilder b;
  nlohmann::json attributes = {{"POSITION", b.floats(kTriangle, "VEC3", 3)}};
  for (int set = 0; set < 4; ++set) {
    const float x = static_cast<float>(set);
    attributes["TEXCOORD_" + std::to_string(set)] = b.floats({x, 0, x, 1, x, 2}, "VEC2", 2);
  }
  b.primitive(attributes);
  const Mesh mesh = only_mesh(b);
  for (std::size_t set = 0; set < 4; ++set) EXPECT_EQ(mesh.uv[set].at(1), Vec2f(static_cast<float>(set), 1));
}

TEST(GltfAccessor, PointsAndLinesGiveOneWarning) {
  GltfBuilder b;
  const int position = b.floats(kTriangle, "VEC3", 3);
  b.primitive({{"POSITION", position}});
  for (const int mode : {0, 1, 2, 3}) {
    b.json["meshes"][0]["primitives"].push_back({{"attributes", {{"POSITION", position}}}, {"mode", mode}});
  }
  const auto scene = b.load();
  ASSERT_TRUE(scene.has_value());
  EXPECT_EQ(scene->meshes.size(), 1u);
  int warnings = 0;
  for (const std::string& w : scene->warnings)
    warnings += w.find("4 primitives of points or lines") != std::string::npos;
  EXPECT_EQ(warnings, 1) << PrintToString(scene->warnings);
}

TEST(GltfAccessor, ZeroAndOverlongNormalsAreRepaired) {
  GltfBuilder b;
  const int position = b.floats(kTriangle, "VEC3", 3);
  b.primitive({{"POSITION", position}, {"NORMAL", b.floats({0, 0, 0, 0, 0, 5, 0, 0, 1}, "VEC3", 3)}});
  const Mesh mesh = only_mesh(b);
  for (const Vec3f& n : mesh.normals) EXPECT_EQ(n, Vec3f(0, 0, 1));
}

}  // namespace
}  // namespace pf
