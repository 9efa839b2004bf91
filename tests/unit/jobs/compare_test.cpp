#include "jobs/compare.h"

#include <filesystem>
#include <limits>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "common/film/image.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

class Compare : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(write_exr(folder_ / "ref.exr", make_image(1.0f)));
    ASSERT_TRUE(write_exr(folder_ / "a.exr", make_image(1.25f)));
  }

  [[nodiscard]] static LayeredImage make_image(float scale) {
    LayeredImage image{
        16, 8, {{"", {"R", "G", "B"}, {}}, {"direct", {"R", "G", "B"}, {}}, {"normal", {"X", "Y", "Z"}, {}}}, {}};
    for (Layer& layer : image.layers) {
      for (int i = 0; i < 16 * 8 * 3; ++i) layer.data.push_back(scale * static_cast<float>(i % 5 + 1));
    }
    return image;
  }
  [[nodiscard]] CompareOptions options(bool json = false) const {
    return {folder_ / "a.exr", folder_ / "ref.exr", json, {}};
  }
  TempFolder temp_;
  const fs::path& folder_ = temp_.path();
};

TEST_F(Compare, JsonIsOneDocumentWithEveryFigure) {
  const auto text = run_compare(options(true));
  ASSERT_TRUE(text) << text.error().message;
  const auto document = nlohmann::json::parse(*text);
  EXPECT_EQ(document["width"], 16);
  EXPECT_EQ(document["height"], 8);
  EXPECT_DOUBLE_EQ(document["mean_ratio"], 1.25);
  EXPECT_DOUBLE_EQ(document["max_error"], 1.25);
  EXPECT_GT(document["relative_mse"], 0.05);
  EXPECT_LT(document["relative_mse"], 0.0625);
  EXPECT_LE(document["relative_mse_trimmed"], document["relative_mse"]);
  EXPECT_GT(document["hdr_flip"]["mean"], 0.01);
  EXPECT_GE(document["hdr_flip"]["exposures"], 2);
  EXPECT_TRUE(document["ldr_flip"]["mean"].is_number());
  EXPECT_EQ(document["image_negative_pixels"], 0);
  EXPECT_EQ(document["layers"].size(), 1u);  // "normal" holds no colours
  EXPECT_DOUBLE_EQ(document["layers"]["direct"]["mean_ratio"], 1.25);
}

TEST_F(Compare, TableNamesTheFigures) {
  const auto text = run_compare(options());
  ASSERT_TRUE(text);
  for (const char* name :
       {"relMSE ", "relMSE trimmed", "RMSE", "SMAPE", "mean ratio", "1.25", "HDR-FLIP mean", "direct", "16x8"}) {
    EXPECT_NE(text->find(name), std::string::npos) << name << " in\n" << *text;
  }
  EXPECT_EQ(text->find("negative"), std::string::npos);
}

TEST_F(Compare, FindsNoErrorAgainstItself) {
  CompareOptions same = options(true);
  same.image = same.reference;
  const auto document = nlohmann::json::parse(*run_compare(same));
  for (const char* figure : {"relative_mse", "relative_mse_trimmed", "rmse", "mae", "smape", "max_error"}) {
    EXPECT_EQ(document[figure], 0.0) << figure;
  }
  EXPECT_EQ(document["hdr_flip"]["mean"], 0.0);
}

TEST_F(Compare, RefusesOtherSizesNamingBoth) {
  LayeredImage other = make_image(1.0f);
  other.width = 8;
  other.height = 16;
  ASSERT_TRUE(write_exr(folder_ / "a.exr", other));
  const auto result = run_compare(options());
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().kind, ErrorKind::kInvalidInput);
  EXPECT_NE(result.error().message.find("8x16 pixels; expected 16x8"), std::string::npos) << result.error().message;
}

TEST_F(Compare, RefusesNonFinitePixelsNamingTheFirst) {
  LayeredImage broken = make_image(1.0f);
  broken.layers[0].data[3 * (16 * 2 + 5) + 1] = std::numeric_limits<float>::quiet_NaN();
  broken.layers[0].data[3 * (16 * 7 + 15)] = std::numeric_limits<float>::infinity();
  ASSERT_TRUE(write_exr(folder_ / "a.exr", broken));
  for (const bool swapped : {false, true}) {
    CompareOptions which = options();
    if (swapped) std::swap(which.image, which.reference);
    const auto result = run_compare(which);
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().kind, ErrorKind::kInvalidInput);
    EXPECT_NE(result.error().message.find("a.exr: 2 pixels are NaN or infinite, the first at x = 5, y = 2"),
              std::string::npos)
        << result.error().message;
  }
}

TEST_F(Compare, ANonFiniteLayerLeavesTheBeautyComparable) {
  LayeredImage broken = make_image(1.0f);
  broken.layers[1].data[0] = std::numeric_limits<float>::quiet_NaN();
  ASSERT_TRUE(write_exr(folder_ / "a.exr", broken));
  const auto document = nlohmann::json::parse(*run_compare(options(true)));
  EXPECT_EQ(document["relative_mse"], 0.0);
  EXPECT_TRUE(document["layers"]["direct"]["relative_mse"].is_null());
  EXPECT_EQ(document["layers"]["direct"]["image_nonfinite_pixels"], 1);
  EXPECT_NE(run_compare(options())->find("1 NaN or infinite pixels in the image"), std::string::npos);
}

TEST_F(Compare, RefusesFilesThatItCannotRead) {
  CompareOptions absent = options();
  absent.reference = folder_ / "absent.exr";
  EXPECT_EQ(run_compare(absent).error().kind, ErrorKind::kInvalidInput);
  EXPECT_NE(run_compare(absent).error().message.find("absent.exr: no such file"), std::string::npos);
  LayeredImage colorless = make_image(1.0f);
  colorless.layers.erase(colorless.layers.begin());
  ASSERT_TRUE(write_exr(folder_ / "a.exr", colorless));
  EXPECT_NE(run_compare(options()).error().message.find("no channels R, G, B"), std::string::npos);
}

TEST_F(Compare, WritesTheErrorImageAsPngOrExr) {
  CompareOptions with_image = options();
  with_image.error_image = folder_ / "error.png";
  ASSERT_TRUE(run_compare(with_image));
  EXPECT_GT(fs::file_size(folder_ / "error.png"), 50u);
  with_image.error_image = folder_ / "error.exr";
  ASSERT_TRUE(run_compare(with_image));
  const auto image = read_exr(folder_ / "error.exr");
  ASSERT_TRUE(image);
  EXPECT_NEAR(image->find("")->data[0], 0.0625f / 1.01f, 1e-6f);
  EXPECT_EQ(image->find("flip")->channels, std::vector<std::string>{"Y"});
  with_image.error_image = folder_ / "error.jpg";
  EXPECT_EQ(run_compare(with_image).error().kind, ErrorKind::kUsage);
  with_image.error_image = folder_ / "absent" / "error.png";
  EXPECT_EQ(run_compare(with_image).error().kind, ErrorKind::kInternal);
}

}  // namespace
}  // namespace pf
