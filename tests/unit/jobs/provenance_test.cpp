#include "jobs/provenance.h"

#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

#include "build_id.h"
#include "common/film/film.h"
#include "common/film/render_result.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

class ImageOriginTest : public testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(temp_ / "scene");
    std::ofstream(temp_ / "scene" / "a.gltf")
        << R"({"asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin", "byteLength": 5}]})";
    std::ofstream(temp_ / "scene" / "a.bin") << "12345";
    auto spec = parse_job_toml(
        "spec_version = 1\n[job]\nname = \"glass\"\n[scene]\nfile = \"a.gltf\"\n[stop]\npasses = 0\nseconds "
        "= 5\nerror = 0.1\n",
        "a");
    ASSERT_TRUE(spec) << spec.error().message;
    spec_ = *spec;
    spec_.folder = temp_ / "scene";
  }
  /// An image of three passes of this job.
  [[nodiscard]] fs::path image() {
    FilmOptions options;
    options.width = 4;
    options.height = 2;
    options.estimator = Estimator::kPath;
    Film film(options);
    film.sums().sub_passes = 3;
    film.sums().pixels[0].direct[0] = 77;
    ResultLabels labels;
    labels.name = "glass";
    labels.spec_json = canonical_json(spec_);
    labels.files = file_list_json(hashed_files_of_job(spec_).value());
    RenderResult result;
    EXPECT_TRUE(write_images(film, labels, temp_.path(), result));
    hash_ = result.image_hash;
    return result.exr;
  }
  TempFolder temp_;
  JobSpec spec_;
  std::string hash_;
};

TEST_F(ImageOriginTest, SaysWhatWouldGiveTheSameImage) {
  const auto origin = read_origin(image());
  ASSERT_TRUE(origin) << origin.error().message;
  EXPECT_EQ(origin->spec.job.name, "glass");
  EXPECT_EQ(origin->spec.stop.passes, 3);
  EXPECT_EQ(origin->spec.stop.seconds, 0) << "time stopped it; passes stop it again";
  EXPECT_EQ(origin->spec.stop.error, 0);
  EXPECT_TRUE(origin->spec.integrator.error_estimate) << "the same layers";
  EXPECT_EQ(origin->files.size(), 2U);
  EXPECT_EQ(origin->image_hash, hash_);
  EXPECT_EQ(origin->build_id, kBuildId);
  EXPECT_EQ(origin->state_chain.size(), 64U);
}

TEST_F(ImageOriginTest, AnotherSceneIsRefused) {
  auto origin = read_origin(image());
  ASSERT_TRUE(origin);
  EXPECT_TRUE(use_scene_folder(*origin, temp_ / "scene"));
  std::ofstream(temp_ / "scene" / "a.bin") << "54321";
  const auto used = use_scene_folder(*origin, temp_ / "scene");
  ASSERT_FALSE(used);
  EXPECT_NE(used.error().message.find("a.bin: has another content"), std::string::npos) << used.error().message;
}

TEST_F(ImageOriginTest, OthersImagesAreRefusedAndFileListsCannotLeadOut) {
  LayeredImage foreign{1, 1, {{"", {"R", "G", "B"}, {1, 2, 3}}}, {}};
  ASSERT_TRUE(write_exr(temp_ / "foreign.exr", foreign));
  const auto origin = read_origin(temp_ / "foreign.exr");
  ASSERT_FALSE(origin);
  EXPECT_EQ(exit_code(origin.error().kind), 3);
  const std::string hash(64, 'a');
  for (const char* path : {"../a", "/etc/passwd", "a/../../b", ""})
    EXPECT_FALSE(
        parse_file_list(R"([{"path": ")" + std::string(path) + R"(", "sha256": ")" + hash + R"(", "bytes": 1}])"))
        << path;
  for (const char* text : {"", "{", "[1]", "[{}]", R"([{"path": "a", "sha256": "AA", "bytes": 1}])"})
    EXPECT_FALSE(parse_file_list(text)) << text;
  EXPECT_TRUE(parse_file_list("[]"));
}

}  // namespace
}  // namespace pf
