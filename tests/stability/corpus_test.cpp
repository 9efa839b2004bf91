// Every file of the shared test data through the renderer: valid scenes give finite pixels, broken files an
// error or a warning. What the messages say is tested beside the loader; here it is that nothing crashes,
// hangs or keeps silent.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <span>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "common/base/clock.h"
#include "tests/support/paths.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/render_job.h"
#include "worker/scene/environment.h"

namespace pf::test {
namespace {

namespace fs = std::filesystem;

constexpr int kImageEdge = 8;               ///< pixels
constexpr std::int64_t kPassPhotons = 200;  ///< paths of a sub-pass
constexpr int kNearest = 8, kGatherRays = 16;
constexpr double kSlowSeconds = 3.0;  ///< a file that takes longer is printed

fs::path scenes_folder() { return test::shared_dir() / "scenes"; }

std::vector<fs::path> files_below(const fs::path& folder, const std::vector<std::string>& extensions) {
  std::vector<fs::path> files;
  if (!fs::exists(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string extension = entry.path().extension().string();
    const bool wanted =
        extensions.empty() || std::find(extensions.begin(), extensions.end(), extension) != extensions.end();
    if (entry.is_regular_file() && wanted) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<fs::path> scenes_below(const fs::path& folder) { return files_below(folder, {".gltf", ".glb"}); }

/// Prints a file that took long, so that a slow machine's log says which.
class Stopwatch {
 public:
  explicit Stopwatch(const fs::path& file) : file_(file), start_(clock_.now()) {}
  ~Stopwatch() {
    const double seconds = clock_.now() - start_;
    if (seconds > kSlowSeconds) std::printf("slow: %.1f s: %s\n", seconds, file_.c_str());
  }
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;

 private:
  SystemClock clock_;
  fs::path file_;
  double start_;
};

JobSpec job_for(const fs::path& file, IntegratorType type) {
  JobSpec spec = job(kImageEdge, kImageEdge, type, kPassPhotons);
  spec.folder = file.parent_path();
  spec.scene.file = file.filename().string();
  spec.photon_map.caustic_photons = kPassPhotons;
  spec.photon_map.nearest = spec.photon_map.caustic_nearest = kNearest;
  spec.final_gather.rays = spec.irradiance_cache.rays = kGatherRays;
  return spec;
}

/// What is wrong with an image that may hold nothing but finite numbers, of which only normals and the bias
/// may be negative; empty when all is well.
std::string fault_of(const LayeredImage& image) {
  for (const Layer& layer : image.layers) {
    const bool is_signed = layer.name == "normal" || layer.name == "error";
    for (std::size_t i = 0; i < layer.data.size(); ++i) {
      const float value = layer.data[i];
      if (!std::isfinite(value) || (!is_signed && value < 0.0f)) {
        return "layer '" + layer.name + "' holds " + std::to_string(value) + " at " + std::to_string(i);
      }
    }
  }
  return {};
}

constexpr std::array kConsistent{IntegratorType::kPath, IntegratorType::kSppm};
constexpr std::array kMethods{IntegratorType::kPath,        IntegratorType::kPhotonMap,
                              IntegratorType::kFinalGather, IntegratorType::kIrradianceCache,
                              IntegratorType::kPhotonSplat, IntegratorType::kPpm,
                              IntegratorType::kSppm};

/// Renders a loaded scene by each method, and says what is wrong.
std::string fault_of_renders(const LoadedJob& loaded, std::span<const IntegratorType> methods) {
  for (const IntegratorType type : methods) {
    JobSpec spec = loaded.spec;
    spec.integrator.type = type;
    // All map methods share the code; finding the cells of the environment's views takes longer than such a
    // small render.
    if (type != IntegratorType::kPhotonMap) spec.photon_map.projection_map = Switch::kOff;
    const Film film = render(*loaded.scene, spec, 2);
    const Faults& faults = film.sums().faults;
    const std::string name(to_string(type));
    if (faults.not_finite > 0) return name + ": " + std::to_string(faults.not_finite) + " contributions are not finite";
    if (faults.overflow > 0) return name + ": " + std::to_string(faults.overflow) + " sums overflow";
    if (std::string fault = fault_of(film.image()); !fault.empty()) return name + ": " + fault;
  }
  return {};
}

/// Valid files that need something of glTF that is not supported: each must say so.
bool is_refused(const fs::path& file) {
  const std::string name = file.filename().string();
  for (const char* refused : {"BoxMeshopt.glb", "14_emission_strength.gltf", "IridescenceSuzanne.glb",
                              "Compatibility_04.gltf", "Compatibility_05.gltf"}) {
    if (name == refused) return true;
  }
  return false;
}

/// A folder as part of a test's name.
std::string name_of_folder(const testing::TestParamInfo<const char*>& folder) {
  std::string name = folder.param;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0; }, '_');
  return name;
}

class ValidScenes : public testing::TestWithParam<const char*> {};

TEST_P(ValidScenes, RenderToFinitePixels) {
  const std::vector<fs::path> files = scenes_below(scenes_folder() / GetParam());
  if (files.empty()) GTEST_SKIP() << "no shared test data";
  const SystemClock clock;
  for (const fs::path& file : files) {
    const Stopwatch stopwatch(file);
    const auto loaded = load_job_scene(job_for(file, IntegratorType::kPath), clock);
    if (is_refused(file)) {
      ASSERT_FALSE(loaded.has_value()) << file;
      EXPECT_EQ(loaded.error().kind, ErrorKind::kInvalidInput) << loaded.error().message;
      continue;
    }
    ASSERT_TRUE(loaded.has_value()) << file << ": " << loaded.error().message;
    EXPECT_EQ(fault_of_renders(*loaded, kMethods), "") << file;
  }
}

INSTANTIATE_TEST_SUITE_P(Corpus, ValidScenes,
                         testing::Values("analytic", "asset-generator", "caustics", "glass", "interior", "loader",
                                         "pbr", "reference_mitsuba"),
                         name_of_folder);

/// Verdicts of the Khronos validator on its own corpus ("valid", "warn", "invalid") by path; other files are
/// broken.
std::map<std::string, std::string> validator_verdicts() {
  std::map<std::string, std::string> verdicts;
  std::ifstream table(scenes_folder() / "invalid/validator/expected.tsv");
  for (std::string line; std::getline(table, line);) {
    std::istringstream fields(line);
    std::string verdict, path;
    std::getline(fields, verdict, '\t');
    std::getline(fields, path, '\t');
    verdicts[(fs::path("validator") / path).generic_string()] = verdict;
  }
  return verdicts;
}

class BrokenScenes : public testing::TestWithParam<const char*> {};

TEST_P(BrokenScenes, GiveAnErrorOrAWarning) {
  const fs::path root = scenes_folder() / "invalid";
  const std::vector<fs::path> files = scenes_below(root / GetParam());
  if (files.empty()) GTEST_SKIP() << "no shared test data";
  const auto verdicts = validator_verdicts();
  const SystemClock clock;
  for (const fs::path& file : files) {
    const Stopwatch stopwatch(file);
    const auto known = verdicts.find(fs::relative(file, root).generic_string());
    const std::string verdict = known == verdicts.end() ? "invalid" : known->second;
    const auto loaded = load_job_scene(job_for(file, IntegratorType::kPath), clock);
    if (!loaded) {
      EXPECT_NE(verdict, "valid") << loaded.error().message;
      EXPECT_EQ(loaded.error().kind, ErrorKind::kInvalidInput) << loaded.error().message;
      EXPECT_NE(loaded.error().message.find(file.filename().string()), std::string::npos) << loaded.error().message;
      continue;
    }
    if (verdict == "invalid") {
      EXPECT_FALSE(loaded->scene->warnings().empty()) << file << " is broken and loads in silence";
    }
    // What loads renders, broken or not.
    EXPECT_EQ(fault_of_renders(*loaded, kConsistent), "") << file;
  }
}

INSTANTIATE_TEST_SUITE_P(Corpus, BrokenScenes,
                         testing::Values("asset-generator", "magnum-TinyGltfImporter", "tinygltf", "validator/base",
                                         "validator/ext"),
                         name_of_folder);

/// A white floor and nothing else: all light is the environment's.
SceneMaker floor_under(const fs::path& map) {
  SceneMaker maker;
  maker.quad({-1, 0, -1}, {0, 0, 2}, {2, 0, 0}, maker.lambert({0.5f, 0.5f, 0.5f}));
  maker.camera({0, 1.5f, 0.01f}, {0, 0, 0}, 0.8f);
  maker.description.environment.file = map.string();
  maker.description.environment.radiance = {1, 1, 1};
  return maker;
}

TEST(Corpus, EnvironmentMapsLightAFloor) {
  const std::vector<fs::path> maps = files_below(scenes_folder() / "env", {".hdr", ".exr"});
  if (maps.empty()) GTEST_SKIP() << "no shared test data";
  for (const fs::path& map : maps) {
    const Stopwatch stopwatch(map);
    const auto scene = Scene::build(floor_under(map).description);
    ASSERT_TRUE(scene.has_value()) << map << ": " << scene.error().message;
    for (const IntegratorType type : kConsistent) {
      const Film film = render(**scene, job(kImageEdge, kImageEdge, type, kPassPhotons), 16);
      const LayeredImage image = film.image();
      EXPECT_EQ(fault_of(image), "") << map;
      EXPECT_EQ(film.sums().faults.not_finite + film.sums().faults.overflow, 0u) << map;
      const std::vector<float>& beauty = image.layers.front().data;
      for (std::size_t i = 0; i < beauty.size(); i += 3) {
        EXPECT_GT(beauty[i] + beauty[i + 1] + beauty[i + 2], 0.0f) << map << " leaves pixel " << i / 3 << " black";
      }
    }
  }
}

TEST(Corpus, OddButValidImagesAreReadAsEnvironments) {
  const std::vector<fs::path> images = files_below(scenes_folder() / "exr", {".exr"});
  if (images.empty()) GTEST_SKIP() << "no shared test data";
  for (const fs::path& file : images) {
    const Stopwatch stopwatch(file);
    std::vector<std::string> warnings;
    const auto map = EnvironmentMap::load({.file = file.string(), .radiance = {1, 1, 1}}, warnings);
    if (file.filename() == "WideFloatRange.exr") {
      // Green and nothing else: neither a colour nor a luminance.
      ASSERT_FALSE(map.has_value());
      EXPECT_NE(map.error().message.find("no R, G, B channels"), std::string::npos) << map.error().message;
      continue;
    }
    ASSERT_TRUE(map.has_value()) << file << ": " << map.error().message;
    EXPECT_TRUE(is_finite(map->total())) << file;
    const auto sample = map->sample({0.3f, 0.7f});
    EXPECT_TRUE(is_finite(sample.radiance) && std::isfinite(sample.pdf_w)) << file;
  }
}

TEST(Corpus, DamagedImagesGiveAnErrorOrAWarning) {
  const std::vector<fs::path> images = files_below(scenes_folder() / "invalid/exr", {});
  if (images.empty()) GTEST_SKIP() << "no shared test data";
  std::size_t refused = 0;
  for (const fs::path& file : images) {
    const Stopwatch stopwatch(file);
    std::vector<std::string> warnings;
    const auto map = EnvironmentMap::load({.file = file.string(), .radiance = {1, 1, 1}}, warnings);
    if (!map) {
      ++refused;
      EXPECT_EQ(map.error().kind, ErrorKind::kInvalidInput) << map.error().message;
      EXPECT_NE(map.error().message.find(file.filename().string()), std::string::npos) << map.error().message;
    } else {
      EXPECT_TRUE(is_finite(map->total())) << file;
      EXPECT_FALSE(warnings.empty()) << file << " is damaged and is read in silence";
    }
  }
  std::printf("%zu of %zu damaged images are refused\n", refused, images.size());
}

}  // namespace
}  // namespace pf::test
