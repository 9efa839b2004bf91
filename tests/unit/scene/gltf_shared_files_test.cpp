// Every glTF file of the shared test data: valid ones load, broken ones give an error or a warning that names
// the fault.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/paths.h"
#include "worker/scene/gltf_loader.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

fs::path scenes() { return test::shared_dir() / "scenes"; }

std::vector<fs::path> gltf_files(const fs::path& folder) {
  std::vector<fs::path> out;
  if (!fs::exists(folder)) return out;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const auto extension = entry.path().extension();
    if (extension == ".gltf" || extension == ".glb") out.push_back(entry.path());
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// Warnings that any odd file gets, whatever is wrong with it.
bool names_a_fault(const std::string& warning) {
  return warning.find("the scene has no surfaces") == std::string::npos &&
         warning.find("the file has no scenes") == std::string::npos;
}

TEST(GltfSharedFiles, ValidScenesLoad) {
  if (!fs::exists(scenes())) GTEST_SKIP() << "no shared test data";
  // What these need in extensionsRequired, or as the least version, is not supported.
  const std::set<std::string> refused = {"BoxMeshopt.glb", "14_emission_strength.gltf", "IridescenceSuzanne.glb",
                                         "Compatibility_04.gltf", "Compatibility_05.gltf"};
  std::size_t loaded = 0;
  for (const char* folder :
       {"analytic", "asset-generator", "caustics", "glass", "interior", "loader", "pbr", "reference_mitsuba"}) {
    for (const fs::path& file : gltf_files(scenes() / folder)) {
      const auto scene = load_gltf({.file = file});
      if (refused.contains(file.filename().string())) {
        ASSERT_FALSE(scene.has_value()) << file;
        EXPECT_TRUE(scene.error().message.find("is required and not supported") != std::string::npos ||
                    scene.error().message.find("only glTF 2.0 can be read") != std::string::npos)
            << scene.error().message;
        continue;
      }
      EXPECT_TRUE(scene.has_value()) << (scene ? "" : scene.error().message);
      ++loaded;
    }
  }
  EXPECT_GE(loaded, 150u);
}

TEST(GltfSharedFiles, BrokenFilesAreNeverSilent) {
  if (!fs::exists(scenes() / "invalid")) GTEST_SKIP() << "no shared test data";
  std::map<std::string, std::string> verdict;  // of the validator's corpus; the other corpora are broken throughout
  std::ifstream table(scenes() / "invalid/validator/expected.tsv");
  for (std::string line; std::getline(table, line);) {
    std::istringstream fields(line);
    std::string what, path;
    std::getline(fields, what, '\t');
    std::getline(fields, path, '\t');
    verdict[path] = what;
  }
  std::size_t broken = 0, errors = 0;
  std::vector<std::string> silent;
  for (const fs::path& file : gltf_files(scenes() / "invalid")) {
    const auto known = verdict.find(fs::relative(file, scenes() / "invalid/validator").generic_string());
    const std::string what = known == verdict.end() ? "invalid" : known->second;
    const auto scene = load_gltf({.file = file});
    if (!scene) {
      EXPECT_EQ(scene.error().kind, ErrorKind::kInvalidInput) << file;
    }
    if (what == "valid") {
      EXPECT_TRUE(scene.has_value()) << (scene ? "" : scene.error().message);
    }
    if (what != "invalid") continue;
    ++broken;
    errors += scene ? 0 : 1;
    if (scene && std::none_of(scene->warnings.begin(), scene->warnings.end(), names_a_fault))
      silent.push_back(file.string());
  }
  std::printf("%zu broken files: %zu errors, %zu warnings, %zu silent\n", broken, errors,
              broken - errors - silent.size(), silent.size());
  EXPECT_TRUE(silent.empty()) << testing::PrintToString(silent);
  EXPECT_GE(broken, 100u);
}

TEST(GltfSharedFiles, MillionTrianglesLoadInLessThanTwoSeconds) {
  const fs::path file = scenes() / "pbr/MetalRoughSpheresNoTextures/MetalRoughSpheresNoTextures.glb";
  if (!fs::exists(file)) GTEST_SKIP() << "no shared test data";
  const auto start = std::chrono::steady_clock::now();
  const auto scene = load_gltf({.file = file});
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  ASSERT_TRUE(scene.has_value());
  std::size_t triangles = 0;
  for (const MeshInstance& i : scene->instances)
    triangles += scene->meshes[static_cast<std::size_t>(i.mesh)].triangles.size();
  EXPECT_GT(triangles, 1'000'000u);
#if defined(NDEBUG) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  EXPECT_LT(seconds, 2.0);
#else
  (void)seconds;
#endif
}

TEST(GltfSharedFiles, SkinnedFigureStandsUpright) {
  const fs::path file = scenes() / "loader/CesiumMan/CesiumMan.glb";
  if (!fs::exists(file)) GTEST_SKIP() << "no shared test data";
  const auto scene = load_gltf({.file = file});
  ASSERT_TRUE(scene.has_value());
  ASSERT_EQ(scene->meshes.size(), 1u);
  EXPECT_EQ(scene->instances[0].object_to_world, Matrix44f());
  Box3f box;
  for (const Vec3f& p : scene->meshes[0].positions) box.extendBy(p);
  EXPECT_GT(box.size().y, 1.3f);  // a person, y up, in metres
  EXPECT_LT(box.size().y, 1.8f);
  EXPECT_GT(box.size().y, box.size().x);
  EXPECT_NEAR(box.min.y, 0.0f, 0.1f);
}

TEST(GltfSharedFiles, DracoGivesWhatTheUncompressedFileGives) {
  const fs::path folder = scenes() / "loader";
  if (!fs::exists(folder)) GTEST_SKIP() << "no shared test data";
  const auto plain = load_gltf({.file = folder / "Box/Box.glb"});
  const auto draco = load_gltf({.file = folder / "Box-glTF-Draco/Box.gltf"});
  ASSERT_TRUE(plain.has_value() && draco.has_value());
  Box3f a, b;
  for (const Vec3f& p : plain->meshes.at(0).positions) a.extendBy(p);
  for (const Vec3f& p : draco->meshes.at(0).positions) b.extendBy(p);
  EXPECT_LT((a.min - b.min).length() + (a.max - b.max).length(), 1e-3f);
  EXPECT_EQ(plain->meshes[0].triangles.size(), draco->meshes[0].triangles.size());
  EXPECT_EQ(draco->meshes[0].normals.size(), draco->meshes[0].positions.size());
}

}  // namespace
}  // namespace pf
