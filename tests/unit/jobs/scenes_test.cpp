#include "jobs/scenes/generate/scenes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <numbers>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <tiny_gltf.h>

#include "common/spec/job_spec.h"
#include "jobs/scenes/generate/mesh.h"
#include "jobs/scenes/generate/profile.h"
#include "tests/support/paths.h"
#include "tests/support/temp_folder.h"

namespace pf::scenes {
namespace {

namespace fs = std::filesystem;

const fs::path kJobs = test::source_dir() / "jobs";
constexpr std::size_t kLargestFile = 1'400'000;  // bytes; the repository stays small

tinygltf::Model load(const Recipe& recipe) {
  tinygltf::Model model;
  tinygltf::TinyGLTF loader;
  std::string error, warning;
  const fs::path file = kJobs / "scenes" / (std::string(recipe.name) + ".glb");
  EXPECT_TRUE(loader.LoadBinaryFromFile(&model, &error, &warning, file.string())) << file << ": " << error;
  EXPECT_EQ(error + warning, "") << file;
  return model;
}

template <typename T>
T read_at(const std::vector<unsigned char>& bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

std::vector<Vec3> vectors(const tinygltf::Model& model, int accessor_index) {
  const auto& accessor = model.accessors.at(static_cast<std::size_t>(accessor_index));
  const auto& view = model.bufferViews.at(static_cast<std::size_t>(accessor.bufferView));
  EXPECT_EQ(accessor.count * 12, view.byteLength);
  std::vector<Vec3> result;
  for (std::size_t i = 0; i < accessor.count; ++i) {
    const auto at = [&](std::size_t k) {
      return static_cast<double>(read_at<float>(model.buffers[0].data, view.byteOffset + 12 * i + 4 * k));
    };
    result.emplace_back(at(0), at(1), at(2));
  }
  return result;
}

/// A primitive as a Mesh in world space.
Mesh mesh_of(const tinygltf::Model& model, const tinygltf::Node& node) {
  const auto& primitive = model.meshes.at(static_cast<std::size_t>(node.mesh)).primitives.at(0);
  Mesh mesh;
  mesh.positions = vectors(model, primitive.attributes.at("POSITION"));
  if (primitive.attributes.contains("NORMAL")) mesh.normals = vectors(model, primitive.attributes.at("NORMAL"));
  const auto& accessor = model.accessors.at(static_cast<std::size_t>(primitive.indices));
  const auto& view = model.bufferViews.at(static_cast<std::size_t>(accessor.bufferView));
  const bool is_short = accessor.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
  std::vector<std::uint32_t> indices;
  for (std::size_t i = 0; i < accessor.count; ++i) {
    const auto& data = model.buffers[0].data;
    indices.push_back(is_short ? read_at<std::uint16_t>(data, view.byteOffset + 2 * i)
                               : read_at<std::uint32_t>(data, view.byteOffset + 4 * i));
    EXPECT_LT(indices.back(), mesh.positions.size());
  }
  for (std::size_t i = 0; i < indices.size(); i += 3) {
    mesh.triangles.push_back({indices[i], indices[i + 1], indices[i + 2]});
  }
  for (Vec3& p : mesh.positions) {
    for (std::size_t k = 0; k < 3; ++k) {
      double& x = p[static_cast<int>(k)];
      if (!node.scale.empty()) x *= node.scale[k];
      if (!node.translation.empty()) x += node.translation[k];
    }
  }
  return mesh;
}

const tinygltf::Material& material_of(const tinygltf::Model& model, const tinygltf::Node& node) {
  const auto& primitive = model.meshes.at(static_cast<std::size_t>(node.mesh)).primitives.at(0);
  return model.materials.at(static_cast<std::size_t>(primitive.material));
}

Vec3 scaled_normal(const Mesh& mesh, const std::array<std::uint32_t, 3>& t) {
  const Vec3& a = mesh.positions[t[0]];
  return (mesh.positions[t[1]] - a).cross(mesh.positions[t[2]] - a);
}

double volume(const Mesh& mesh) {
  double sum = 0;
  for (const auto& t : mesh.triangles) sum += mesh.positions[t[0]].dot(scaled_normal(mesh, t));
  return sum / 6.0;
}

/// Edges that are not shared by exactly two triangles running along it in opposite directions; vertices are
/// one when they have the same place.
std::size_t open_edges(const Mesh& mesh) {
  std::map<std::tuple<double, double, double>, std::size_t> places;
  const auto place = [&](std::uint32_t i) {
    const Vec3& p = mesh.positions[i];
    return places.try_emplace({p.x, p.y, p.z}, places.size()).first->second;
  };
  std::map<std::pair<std::size_t, std::size_t>, int> edges;
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) ++edges[{place(t[k]), place(t[(k + 1) % 3])}];
  }
  std::size_t open = 0;
  for (const auto& [edge, count] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    open += count != 1 || edge.first == edge.second || back == edges.end() || back->second != 1;
  }
  return open;
}

const tinygltf::Node& node_named(const tinygltf::Model& model, std::string_view name) {
  for (const auto& node : model.nodes) {
    if (node.name == name) return node;
  }
  throw std::runtime_error("no node is named " + std::string(name));
}

Mesh mesh_named(std::string_view scene, std::string_view node) {
  for (const Recipe& recipe : recipes()) {
    if (recipe.name != scene) continue;
    const tinygltf::Model model = load(recipe);
    return mesh_of(model, node_named(model, node));
  }
  return {};
}

std::pair<Vec3, Vec3> bounds(const Mesh& mesh) {
  Vec3 low(1e9), high(-1e9);
  for (const Vec3& p : mesh.positions) {
    for (int k = 0; k < 3; ++k) low[k] = std::min(low[k], p[k]), high[k] = std::max(high[k], p[k]);
  }
  return {low, high};
}

void expect_bounds(const Mesh& mesh, const Vec3& low, const Vec3& high) {
  const auto [l, h] = bounds(mesh);
  EXPECT_LT((l - low).length(), 1e-6) << l << " instead of " << low;
  EXPECT_LT((h - high).length(), 1e-6) << h << " instead of " << high;
}

/// Radii of the mesh's vertices about the vertical through `axis`, smallest and largest, between two heights.
std::pair<double, double> radii(const Mesh& mesh, const Vec2& axis, double low, double high) {
  std::pair<double, double> r{1e9, 0};
  for (const Vec3& p : mesh.positions) {
    if (p.y < low || p.y > high) continue;
    const double d = std::hypot(p.x - axis.x, p.z - axis.y);
    r = {std::min(r.first, d), std::max(r.second, d)};
  }
  return r;
}

TEST(Scenes, AreTheCommittedBytesWhenMadeAgain) {
  const TempFolder temp;
  const fs::path& folder = temp.path();
  ASSERT_TRUE(write_scenes(folder).has_value());
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string made = bytes_of(entry.path());
    const fs::path committed = kJobs / "scenes" / entry.path().filename();
    EXPECT_LT(made.size(), kLargestFile) << entry.path();
    EXPECT_TRUE(made == bytes_of(committed)) << committed << " differs; run photonfarm-make-scenes jobs/scenes";
    ++files;
  }
  EXPECT_EQ(files, recipes().size());
}

TEST(Scenes, AreMadeAloneWhenNamed) {
  const TempFolder folder;
  ASSERT_TRUE(write_scenes(folder.path(), {"ring"}).has_value());
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);
  EXPECT_TRUE(fs::exists(folder / "ring.glb"));
}

TEST(Scenes, RefuseAnUnknownNameAndSayWhichExist) {
  const TempFolder folder;
  const auto done = write_scenes(folder.path(), {"rings"});
  ASSERT_FALSE(done.has_value());
  EXPECT_EQ(done.error().kind, ErrorKind::kUsage);
  EXPECT_NE(done.error().message.find("'rings'"), std::string::npos);
  EXPECT_NE(done.error().message.find("cornell-box, glass-caustic"), std::string::npos);
}

TEST(Scenes, CannotBeWrittenBelowAFile) {
  const TempFolder folder;
  const fs::path file = folder / "file";
  std::ofstream(file) << "x";
  const auto done = write_scenes(file / "inside");
  ASSERT_FALSE(done.has_value());
  EXPECT_EQ(done.error().kind, ErrorKind::kInternal);
}

TEST(Scenes, HaveOneNamedPerspectiveCameraAndSomethingThatShines) {
  for (const Recipe& recipe : recipes()) {
    const tinygltf::Model model = load(recipe);
    ASSERT_EQ(model.cameras.size(), 1U) << recipe.name;
    EXPECT_EQ(model.cameras[0].type, "perspective");
    EXPECT_EQ(model.cameras[0].name, "camera");
    bool shines = !model.lights.empty();
    for (const auto& material : model.materials)
      shines |= material.extensions.contains("KHR_materials_emissive_strength");
    EXPECT_TRUE(shines) << recipe.name;
    EXPECT_TRUE(model.extensionsRequired.empty());
  }
}

TEST(Scenes, HaveUnitNormalsOnTheSideFromWhichTrianglesRunCounterClockwise) {
  for (const Recipe& recipe : recipes()) {
    const tinygltf::Model model = load(recipe);
    for (const auto& node : model.nodes) {
      if (node.mesh < 0) continue;
      const Mesh mesh = mesh_of(model, node);
      std::size_t wrong = 0;
      for (const Vec3& n : mesh.normals) wrong += std::abs(n.length() - 1.0) > 1e-6;
      for (const auto& t : mesh.triangles) {
        const Vec3 g = scaled_normal(mesh, t);
        wrong += !(g.length() > 0);
        if (mesh.normals.empty()) continue;
        for (const std::uint32_t i : t) wrong += mesh.normals[i].dot(g.normalized()) < 0.8;
      }
      EXPECT_EQ(wrong, 0U) << recipe.name << ", " << node.name;
    }
  }
}

TEST(Scenes, HaveWatertightDielectricsWhoseFrontIsOutside) {
  std::size_t dielectrics = 0;
  for (const Recipe& recipe : recipes()) {
    const tinygltf::Model model = load(recipe);
    for (const auto& node : model.nodes) {
      if (node.mesh < 0 || !material_of(model, node).extensions.contains("KHR_materials_transmission")) continue;
      const auto& volume_extension = material_of(model, node).extensions.at("KHR_materials_volume");
      EXPECT_GT(volume_extension.Get("thicknessFactor").GetNumberAsDouble(), 0.0) << node.name;
      const Mesh mesh = mesh_of(model, node);
      EXPECT_EQ(open_edges(mesh), 0U) << recipe.name << ", " << node.name;
      EXPECT_GT(volume(mesh), 0.0) << recipe.name << ", " << node.name;
      ++dielectrics;
    }
  }
  EXPECT_EQ(dielectrics,
            10U);  // ball, peer's ball, furnace's ball, water, two glasses, two liquids, two marbles
}

TEST(Scenes, HaveNothingButPureLambertSurfacesBesideMetalAndGlass) {
  for (const Recipe& recipe : recipes()) {
    for (const auto& material : load(recipe).materials) {
      if (material.pbrMetallicRoughness.metallicFactor > 0) continue;
      if (material.extensions.contains("KHR_materials_transmission")) continue;
      ASSERT_TRUE(material.extensions.contains("KHR_materials_specular")) << recipe.name << ", " << material.name;
      EXPECT_EQ(material.extensions.at("KHR_materials_specular").Get("specularFactor").GetNumberAsDouble(), 0.0);
    }
  }
}

TEST(Scenes, TurnTheFrontOfEachLampTowardsWhatItLights) {
  const auto normal = [](const Mesh& mesh) { return scaled_normal(mesh, mesh.triangles[0]).normalized(); };
  EXPECT_NEAR(normal(mesh_named("cornell-box", "light")).y, -1.0, 1e-9);
  EXPECT_NEAR(normal(mesh_named("peer-box", "light")).y, -1.0, 1e-9);
  EXPECT_LT(volume(mesh_named("white-furnace", "room")), 0.0);  // front inside
  EXPECT_GT(volume(mesh_named("ring", "lamp")), 0.0);           // front outside
  for (const auto& [scene, lamp] : {std::pair("glass-caustic", "lamp"), std::pair("glass-caustic", "panel")}) {
    const Mesh mesh = mesh_named(scene, lamp);
    EXPECT_GT(normal(mesh).dot((Vec3(0, 0.1, 0) - mesh.positions[0]).normalized()), 0.7) << lamp;
  }
  const Mesh panel = mesh_named("interior", "sky panel");
  EXPECT_GT(normal(panel).dot((Vec3(-2.0, 1.5, -1.0) - panel.positions[0]).normalized()), 0.7);
}

TEST(Scenes, AreAsLargeAsDocumented) {
  expect_bounds(mesh_named("peer-box", "mirror"), {-0.42, 0.0, -0.38}, {-0.02, 0.4, 0.02});
  expect_bounds(mesh_named("peer-box", "glass"), {0.04, 0.0, -0.06}, {0.40, 0.36, 0.30});
  expect_bounds(mesh_named("peer-box", "light"), {-0.125, 0.998, -0.125}, {0.125, 0.998, 0.125});
  expect_bounds(mesh_named("peer-box", "back"), {-0.5, 0, -0.5}, {0.5, 1, -0.5});
  expect_bounds(mesh_named("cornell-box", "tall block"), {-0.194, 0, -0.456}, {0.013, 0.330, -0.247});
  expect_bounds(mesh_named("cornell-box", "light"), {-0.065, 0.5478, -0.332}, {0.065, 0.5478, -0.227});
  expect_bounds(mesh_named("ball-caustic", "ball"), {-0.1, 0.1, -0.1}, {0.1, 0.3, 0.1});
  expect_bounds(mesh_named("white-furnace", "room"), {-1, -1, -1}, {1, 1, 1});
  const auto ring = radii(mesh_named("ring", "ring"), {0, 0}, -1, 1);
  EXPECT_NEAR(ring.first, 0.050, 1e-8);
  EXPECT_NEAR(ring.second, 0.053, 1e-8);
}

TEST(Scenes, LetLiquidsReachATenthOfAMillimetreIntoTheirGlass) {
  const Vec2 bottle(-0.068, -0.060);
  const auto liquor = radii(mesh_named("glass-caustic", "liquor"), bottle, 0.03, 0.12);
  EXPECT_NEAR(liquor.second, 0.0338 + 1e-4, 1e-7);
  const auto glass = radii(mesh_named("glass-caustic", "bottle"), bottle, 0.03, 0.12);
  EXPECT_NEAR(glass.first, 0.0338, 1e-7);
  EXPECT_NEAR(glass.second, 0.0360, 1e-7);
  const auto [wine_low, wine_high] = bounds(mesh_named("glass-caustic", "wine"));
  EXPECT_NEAR(wine_low.y, 0.0865 - 1e-4 + 2e-4, 1e-7);
  EXPECT_LT(wine_high.y, 0.1300);
  const auto [water_low, water_high] = bounds(mesh_named("pool", "water"));
  const auto [tiles_low, tiles_high] = bounds(mesh_named("pool", "tiles"));
  EXPECT_LT(water_low.y, tiles_low.y);
  EXPECT_LT(water_low.x, tiles_low.x);
  EXPECT_GT(water_high.z, tiles_high.z);
  EXPECT_LT(water_high.y, tiles_high.y);
}

TEST(Scenes, HaveAJobBesideThemThatReadsThem) {
  for (const Recipe& recipe : recipes()) {
    const fs::path file = kJobs / (std::string(recipe.name) + ".toml");
    const auto job = load_job(file);
    ASSERT_TRUE(job.has_value()) << job.error().message;
    EXPECT_EQ(job->job.name, recipe.name);
    EXPECT_EQ(job->scene.file, "scenes/" + std::string(recipe.name) + ".glb");
    EXPECT_TRUE(fs::exists(kJobs / job->scene.file));
    EXPECT_GT(job->stop.passes, 0) << "an example ends by itself";
    EXPECT_EQ(bytes_of(file).front(), '#') << "a job says first what it shows";
    const double aspect = load(recipe).cameras[0].perspective.aspectRatio;
    EXPECT_NEAR(aspect, static_cast<double>(job->image.width) / job->image.height, 1e-9) << recipe.name;
  }
}

TEST(Icosphere, HasTheVolumeOfASphereButForItsFlatFaces) {
  const Mesh sphere = icosphere(4);
  EXPECT_EQ(sphere.positions.size(), 2562U);
  EXPECT_EQ(open_edges(sphere), 0U);
  EXPECT_NEAR(volume(sphere) / (4.0 / 3.0 * std::numbers::pi), 1.0, 0.003);
}

TEST(Lathe, TurnsAHalfCircleIntoASphereWithItsNormals) {
  const Mesh sphere = lathe(Profile({0, -1}).arc({0, 0}, 180, 64), 64);
  EXPECT_EQ(open_edges(sphere), 0U);
  EXPECT_NEAR(volume(sphere) / (4.0 / 3.0 * std::numbers::pi), 1.0, 0.004);
  for (std::size_t i = 0; i < sphere.positions.size(); ++i) {
    ASSERT_LT((sphere.positions[i] - sphere.normals[i]).length(), 1e-12);
  }
}

}  // namespace
}  // namespace pf::scenes
