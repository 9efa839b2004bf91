// Nodes, instances, cameras, lights, skins, morph targets, materials, Draco, folders.
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/paths.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/scene/gltf_builder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// 1 x 1 pixel.
const std::string kPng =
    "data:image/png;base64,"
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVQYV2P4z/AfAAQAAf+I0P3MAAAAAElFTkSuQmCC";

GltfBuilder one_triangle() {
  GltfBuilder b;
  const int position = b.floats(kTriangle, "VEC3", 3);
  b.primitive({{"POSITION", position}});
  return b;
}

SceneDescription load(const GltfBuilder& b) {
  auto scene = b.load();
  EXPECT_TRUE(scene.has_value()) << (scene ? "" : scene.error().message);
  return scene ? std::move(*scene) : SceneDescription{};
}

void expect_near(const Vec3f& a, const Vec3f& b) { EXPECT_LT((a - b).length(), 1e-5f) << a << " against " << b; }

TEST(GltfNodes, ChildTransformsComeBeforeTheirParents) {
  GltfBuilder b = one_triangle();
  const float h = std::sqrt(0.5f);
  b.json["nodes"] = {{{"children", {1}}, {"translation", {10, 0, 0}}},
                     {{"mesh", 0}, {"rotation", {0, 0, h, h}}, {"scale", {2, 1, 1}}}};
  const SceneDescription scene = load(b);
  ASSERT_EQ(scene.instances.size(), 1u);
  // (1,0,0) is scaled to (2,0,0), turned by 90 degrees about z to (0,2,0), moved to (10,2,0).
  expect_near(Vec3f(1, 0, 0) * scene.instances[0].object_to_world, Vec3f(10, 2, 0));
}

TEST(GltfNodes, MatrixIsReadColumnAfterColumn) {
  GltfBuilder b = one_triangle();
  b.json["nodes"] = {{{"mesh", 0}, {"matrix", {0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 4, 5, 6, 1}}}};
  const SceneDescription scene = load(b);
  expect_near(Vec3f(1, 0, 0) * scene.instances.at(0).object_to_world, Vec3f(4, 6, 6));
}

TEST(GltfNodes, NegativeScaleKeepsItsDeterminant) {
  GltfBuilder b = one_triangle();
  b.json["nodes"][0]["scale"] = {-1, 1, 1};
  EXPECT_LT(load(b).instances.at(0).object_to_world.determinant(), 0.0f);
}

TEST(GltfNodes, MeshOfTwoNodesIsOneMeshWithTwoInstances) {
  GltfBuilder b = one_triangle();
  b.json["nodes"].push_back({{"mesh", 0}, {"translation", {0, 0, 1}}});
  b.json["scenes"][0]["nodes"] = {0, 1};
  const SceneDescription scene = load(b);
  EXPECT_EQ(scene.meshes.size(), 1u);
  ASSERT_EQ(scene.instances.size(), 2u);
  EXPECT_EQ(scene.instances[1].mesh, 0);
}

TEST(GltfNodes, GpuInstancingPlacesTheMeshOncePerElement) {
  GltfBuilder b = one_triangle();
  b.use("EXT_mesh_gpu_instancing");
  const int translation = b.floats({1, 0, 0, 2, 0, 0}, "VEC3", 3);
  const int scale = b.floats({1, 1, 1, 3, 3, 3}, "VEC3", 3);
  b.json["nodes"][0]["translation"] = {0, 5, 0};
  b.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {{"TRANSLATION", translation},
                                                                               {"SCALE", scale}};
  const SceneDescription scene = load(b);
  ASSERT_EQ(scene.instances.size(), 2u);
  EXPECT_EQ(scene.meshes.size(), 1u);
  expect_near(Vec3f(1, 0, 0) * scene.instances[1].object_to_world, Vec3f(5, 5, 0));
}

TEST(GltfNodes, SceneIsChosenByNameOrIndexAndUnknownOnesListThem) {
  GltfBuilder b = one_triangle();
  b.json["nodes"].push_back({{"mesh", 0}, {"translation", {7, 0, 0}}});
  b.json["scenes"] = {{{"name", "left"}, {"nodes", {0}}}, {{"name", "right"}, {"nodes", {1}}}};
  const TempFolder folder;
  const fs::path file = folder / "scene.glb";
  const auto bytes = b.glb();
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  const auto x = [&](const std::string& name) {
    const auto scene = load_gltf({.file = file, .scene = name});
    return scene ? scene->instances.at(0).object_to_world[3][0] : -1.0f;
  };
  EXPECT_EQ(x(""), 0.0f);
  EXPECT_EQ(x("right"), 7.0f);
  EXPECT_EQ(x("1"), 7.0f);
  const auto unknown = load_gltf({.file = file, .scene = "middle"});
  ASSERT_FALSE(unknown.has_value());
  EXPECT_NE(unknown.error().message.find("no scene \"middle\"; the file has \"left\" (0), \"right\" (1)"),
            std::string::npos);
}

TEST(GltfNodes, SkinPutsVerticesWhereTheirJointsAre) {
  GltfBuilder b;
  const int position = b.floats(kTriangle, "VEC3", 3);
  const int joints = b.accessor(b.view(std::vector<std::uint8_t>{0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0}), 5121, "VEC4", 3);
  const int weights = b.floats({1, 0, 0, 0, 0.5f, 0.5f, 0, 0, 0, 1, 0, 0}, "VEC4", 4);
  b.primitive({{"POSITION", position}, {"JOINTS_0", joints}, {"WEIGHTS_0", weights}});
  // Inverse bind matrices: the second joint is bound at (0, 0, 1).
  const int bind = b.floats(
      {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -1, 1}, "MAT4", 16);
  b.json["skins"] = {{{"joints", {1, 2}}, {"inverseBindMatrices", bind}}};
  b.json["nodes"] = {{{"mesh", 0}, {"skin", 0}, {"translation", {100, 0, 0}}},  // ignored: it is skinned
                     {{"children", {2}}, {"translation", {0, 2, 0}}},
                     {{"translation", {0, 0, 3}}}};
  b.json["scenes"][0]["nodes"] = {0, 1};
  const SceneDescription scene = load(b);
  EXPECT_EQ(scene.instances.at(0).object_to_world, Matrix44f());
  const auto& p = scene.meshes.at(0).positions;
  expect_near(p[0], Vec3f(0, 2, 0));  // joint 0 alone
  expect_near(p[1], Vec3f(1, 2, 1));  // half of joint 0, half of joint 1 (0, 2, 2)
  expect_near(p[2], Vec3f(0, 3, 2));  // joint 1 alone
}

TEST(GltfNodes, MorphTargetsCountByTheNodesWeightsElseTheMeshs) {
  GltfBuilder b = one_triangle();
  const int delta = b.floats({0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3", 3);
  b.json["meshes"][0]["primitives"][0]["targets"] = {{{"POSITION", delta}}};
  b.json["meshes"][0]["weights"] = {0.25};
  b.json["nodes"].push_back({{"mesh", 0}, {"weights", {2.0}}});
  b.json["scenes"][0]["nodes"] = {0, 1};
  const SceneDescription scene = load(b);
  ASSERT_EQ(scene.meshes.size(), 2u);
  EXPECT_FLOAT_EQ(scene.meshes[0].positions[0].z, 0.25f);
  EXPECT_FLOAT_EQ(scene.meshes[1].positions[0].z, 2.0f);
}

TEST(GltfCameras, ScaleAndMirroringAreTakenOut) {
  GltfBuilder b = one_triangle();
  b.json["cameras"] = {
      {{"type", "perspective"},
       {"name", "eye"},
       {"perspective", {{"yfov", 0.8}, {"aspectRatio", 1.5}, {"znear", 0.1}}}},
      {{"type", "orthographic"}, {"orthographic", {{"xmag", 2}, {"ymag", 3}, {"znear", 0}, {"zfar", 1}}}}};
  b.json["nodes"].push_back({{"camera", 0}, {"translation", {1, 2, 3}}, {"scale", {-4, 4, 4}}});
  b.json["nodes"].push_back({{"camera", 1}, {"name", "plan"}});
  b.json["scenes"][0]["nodes"] = {0, 1, 2};
  const SceneDescription scene = load(b);
  ASSERT_EQ(scene.cameras.size(), 2u);
  EXPECT_EQ(scene.cameras[0].name, "eye");
  EXPECT_NEAR(scene.cameras[0].camera_to_world.determinant(), 1.0f, 1e-5f);
  expect_near(Vec3f(0, 0, 0) * scene.cameras[0].camera_to_world, Vec3f(1, 2, 3));
  EXPECT_FLOAT_EQ(scene.cameras[0].aspect_ratio, 1.5f);
  EXPECT_EQ(scene.cameras[1].name, "plan");
  EXPECT_TRUE(scene.cameras[1].orthographic);
  EXPECT_FLOAT_EQ(scene.cameras[1].ymag, 3.0f);
}

TEST(GltfCameras, SceneWithoutOneIsFramed) {
  GltfBuilder b = one_triangle();
  b.json["nodes"][0]["translation"] = {50, 0, 0};
  b.json["nodes"][0]["scale"] = {4, 4, 4};
  const SceneDescription scene = load(b);
  ASSERT_EQ(scene.cameras.size(), 1u);
  const Camera& camera = scene.cameras[0];
  const Matrix44f to_camera = camera.camera_to_world.inverse();
  for (const Vec3f& p : {Vec3f(50, 0, 0), Vec3f(54, 0, 0), Vec3f(50, 4, 0)}) {
    const Vec3f q = p * to_camera;
    ASSERT_LT(q.z, 0.0f);  // in front
    EXPECT_LT(std::abs(q.y / q.z), std::tan(camera.yfov / 2));
    EXPECT_LT(std::abs(q.x / q.z), std::tan(camera.yfov / 2));
  }
}

TEST(GltfLights, StandAndShineWhereTheirNodesSay) {
  GltfBuilder b = one_triangle();
  b.use("KHR_lights_punctual");
  b.json["extensions"]["KHR_lights_punctual"]["lights"] = {
      {{"type", "spot"}, {"intensity", 10}, {"color", {1, 0.5, 0}}, {"spot", {{"outerConeAngle", 0.5}}}},
      {{"type", "directional"}}};
  const float h = std::sqrt(0.5f);
  b.json["nodes"].push_back({{"translation", {0, 4, 0}},
                             {"rotation", {-h, 0, 0, h}},
                             {"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
  b.json["nodes"].push_back({{"scale", {3, 3, 3}}, {"extensions", {{"KHR_lights_punctual", {{"light", 1}}}}}});
  b.json["scenes"][0]["nodes"] = {0, 1, 2};
  const SceneDescription scene = load(b);
  ASSERT_EQ(scene.lights.size(), 2u);
  EXPECT_EQ(scene.lights[0].kind, PunctualKind::kSpot);
  expect_near(scene.lights[0].position, Vec3f(0, 4, 0));
  expect_near(scene.lights[0].direction, Vec3f(0, -1, 0));
  expect_near(scene.lights[0].intensity, Vec3f(10, 5, 0));
  EXPECT_FLOAT_EQ(scene.lights[0].cos_outer, std::cos(0.5f));
  EXPECT_FLOAT_EQ(scene.lights[0].cos_inner, 1.0f);
  expect_near(scene.lights[1].direction, Vec3f(0, 0, -1));
  EXPECT_TRUE(has_light(scene));
  EXPECT_FALSE(has_light(load(one_triangle())));
}

TEST(GltfMaterials, FactorsAndExtensionsArrive) {
  GltfBuilder b = one_triangle();
  for (const char* e : {"emissive_strength", "ior", "transmission", "volume", "clearcoat", "sheen", "specular"}) {
    b.use(std::string("KHR_materials_") + e);
  }
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  b.json["materials"] = {
      {{"name", "all"},
       {"pbrMetallicRoughness", {{"baseColorFactor", {0.1, 0.2, 0.3, 0.4}}, {"metallicFactor", 0.5}}},
       {"emissiveFactor", {1, 0.5, 0}},
       {"alphaMode", "MASK"},
       {"alphaCutoff", 0.7},
       {"doubleSided", true},
       {"extensions",
        {{"KHR_materials_emissive_strength", {{"emissiveStrength", 20}}},
         {"KHR_materials_ior", {{"ior", 1.33}}},
         {"KHR_materials_transmission", {{"transmissionFactor", 0.9}}},
         {"KHR_materials_volume",
          {{"thicknessFactor", 2}, {"attenuationDistance", 3}, {"attenuationColor", {0, 1, 0}}}},
         {"KHR_materials_clearcoat", {{"clearcoatFactor", 0.6}, {"clearcoatRoughnessFactor", 0.2}}},
         {"KHR_materials_sheen", {{"sheenColorFactor", {1, 0, 0}}, {"sheenRoughnessFactor", 0.3}}},
         {"KHR_materials_specular", {{"specularFactor", 0.25}, {"specularColorFactor", {2, 1, 1}}}}}}}};
  const SceneDescription scene = load(b);
  const Material& m = scene.materials.at(0);
  EXPECT_EQ(scene.meshes.at(0).material, 0);
  expect_near(m.base_color, Vec3f(0.1f, 0.2f, 0.3f));
  EXPECT_FLOAT_EQ(m.alpha, 0.4f);
  EXPECT_FLOAT_EQ(m.metallic, 0.5f);
  EXPECT_FLOAT_EQ(m.roughness, 1.0f);
  expect_near(m.emission, Vec3f(20, 10, 0));
  EXPECT_EQ(m.alpha_mode, AlphaMode::kMask);
  EXPECT_FLOAT_EQ(m.alpha_cutoff, 0.7f);
  EXPECT_TRUE(m.double_sided);
  EXPECT_FLOAT_EQ(m.ior, 1.33f);
  EXPECT_FLOAT_EQ(m.transmission, 0.9f);
  EXPECT_FLOAT_EQ(m.thickness, 2.0f);
  EXPECT_FLOAT_EQ(m.attenuation_distance, 3.0f);
  expect_near(m.attenuation_color, Vec3f(0, 1, 0));
  EXPECT_FLOAT_EQ(m.clearcoat, 0.6f);
  EXPECT_FLOAT_EQ(m.clearcoat_roughness, 0.2f);
  EXPECT_FLOAT_EQ(m.sheen_roughness, 0.3f);
  EXPECT_FLOAT_EQ(m.specular, 0.25f);
  expect_near(m.specular_color, Vec3f(2, 1, 1));
  EXPECT_TRUE(has_light(scene));
  EXPECT_TRUE(scene.warnings.size() <= 1u) << testing::PrintToString(scene.warnings);  // POSITION without min and max
}

TEST(GltfMaterials, OneImageInTwoColourSpacesBecomesTwoTextures) {
  GltfBuilder b = one_triangle();
  b.use("KHR_texture_transform");
  b.json["images"] = {{{"uri", kPng}}};
  b.json["samplers"] = {{{"wrapS", 33071}, {"wrapT", 33648}, {"magFilter", 9728}}};
  b.json["textures"] = {{{"source", 0}, {"sampler", 0}}};
  b.json["materials"] = {
      {{"pbrMetallicRoughness",
        {{"baseColorTexture",
          {{"index", 0},
           {"texCoord", 0},
           {"extensions",
            {{"KHR_texture_transform", {{"offset", {0.5, 0}}, {"scale", {2, 3}}, {"rotation", 1}, {"texCoord", 1}}}}}}},
         {"metallicRoughnessTexture", {{"index", 0}}}}},
       {"emissiveTexture", {{"index", 0}}}}};
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  const SceneDescription scene = load(b);
  ASSERT_EQ(scene.textures.size(), 2u);
  const Material& m = scene.materials[0];
  EXPECT_EQ(m.base_color_texture.texture, m.emission_texture.texture);
  EXPECT_NE(m.base_color_texture.texture, m.metallic_roughness_texture.texture);
  const Texture& t = scene.textures[static_cast<std::size_t>(m.base_color_texture.texture)];
  EXPECT_EQ(t.color_space, ColorSpace::kSrgb);
  EXPECT_EQ(t.wrap_s, Wrap::kClamp);
  EXPECT_EQ(t.wrap_t, Wrap::kMirror);
  EXPECT_TRUE(t.nearest);
  ASSERT_TRUE(t.bytes != nullptr);
  EXPECT_EQ(t.bytes->at(1), 'P');
  EXPECT_EQ(t.bytes, scene.textures[static_cast<std::size_t>(m.metallic_roughness_texture.texture)].bytes);
  EXPECT_EQ(m.base_color_texture.uv_set, 1);
  EXPECT_EQ(m.base_color_texture.scale, Vec2f(2, 3));
  EXPECT_EQ(m.base_color_texture.offset, Vec2f(0.5f, 0));
  EXPECT_FLOAT_EQ(m.base_color_texture.rotation, 1.0f);
  EXPECT_EQ(scene.meshes.at(0).uv[1].size(), 3u);  // read by the material, absent in the file
}

json draco_document() {
  std::ifstream stream(test::source_dir() / "tests/fuzz/corpus/gltf/draco.gltf");
  return json::parse(stream);
}

Result<SceneDescription> load(const json& document) {
  const std::string text = document.dump();
  return load_gltf_from_memory({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, {});
}

TEST(GltfDraco, SquareOfTwoTrianglesDecodes) {
  const auto scene = load(draco_document());
  ASSERT_TRUE(scene.has_value()) << scene.error().message;
  ASSERT_EQ(scene->meshes.size(), 1u);
  EXPECT_EQ(scene->meshes[0].triangles.size(), 2u);
  Box3f box;
  for (const Vec3f& p : scene->meshes[0].positions) box.extendBy(p);
  expect_near(box.min, Vec3f(0, 0, 0));
  expect_near(box.max, Vec3f(1, 1, 0));
}

TEST(GltfDraco, CountsOtherThanTheAccessorsSayAreRefused) {
  json document = draco_document();
  document["accessors"][0]["count"] = 4000000000u;
  const auto huge = load(document);
  ASSERT_FALSE(huge.has_value());
  EXPECT_NE(huge.error().message.find("far more data than it holds"), std::string::npos) << huge.error().message;
  document["accessors"][0]["count"] = 5;
  const auto wrong = load(document);
  ASSERT_FALSE(wrong.has_value());
  EXPECT_NE(wrong.error().message.find("hold 4 vertices and 6 indices; the accessors say 5 and 6"), std::string::npos)
      << wrong.error().message;
}

TEST(GltfFolder, LinksOutOfTheRootAreRefused) {
  const TempFolder temp;
  const fs::path& folder = temp.path();
  fs::create_directories(folder / "job");
  std::ofstream(folder / "secret.bin", std::ios::binary) << std::string(36, '\0');
  fs::create_symlink(folder / "secret.bin", folder / "job/inside.bin");
  const json document = {{"asset", {{"version", "2.0"}}}, {"buffers", {{{"uri", "inside.bin"}, {"byteLength", 36}}}}};
  std::ofstream(folder / "job/scene.gltf") << document.dump();
  const auto refused = load_gltf({.file = folder / "job/scene.gltf"});
  ASSERT_FALSE(refused.has_value());
  EXPECT_NE(refused.error().message.find("lies outside the scene's folder"), std::string::npos)
      << refused.error().message;
  EXPECT_TRUE(load_gltf({.file = folder / "job/scene.gltf", .root = folder}).has_value());
  EXPECT_FALSE(load_gltf({.file = folder / "job/scene.gltf", .root = folder / "elsewhere"}).has_value());
  EXPECT_FALSE(load_gltf({.file = folder / "job/none.gltf"}).has_value());
  EXPECT_FALSE(load_gltf({.file = folder / "job"}).has_value());
}

TEST(GltfFolder, UnknownCameraListsThoseOfTheScene) {
  GltfBuilder b = one_triangle();
  b.json["cameras"] = {{{"type", "perspective"}, {"name", "door"}, {"perspective", {{"yfov", 1}, {"znear", 1}}}}};
  b.json["nodes"][0]["camera"] = 0;
  const TempFolder folder;
  const fs::path file = folder / "camera.glb";
  const auto bytes = b.glb();
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  EXPECT_TRUE(load_gltf({.file = file, .camera = "door"}).has_value());
  const auto unknown = load_gltf({.file = file, .camera = "window"});
  ASSERT_FALSE(unknown.has_value());
  EXPECT_NE(unknown.error().message.find("no camera \"window\"; the scene has \"door\""), std::string::npos);
}

}  // namespace
}  // namespace pf
