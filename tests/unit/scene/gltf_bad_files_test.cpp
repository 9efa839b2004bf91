// Small broken files of our own: each says in asset.extras which message it must give, and whether as an
// error or as a warning.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/support/paths.h"
#include "worker/scene/gltf_loader.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> bad_files() {
  std::vector<fs::path> out;
  for (const auto& entry : fs::directory_iterator(test::source_dir() / "tests/unit/scene/bad_gltf")) {
    if (entry.path().extension() == ".gltf") out.push_back(entry.path());
  }
  std::sort(out.begin(), out.end());
  return out;
}

class BadGltf : public testing::TestWithParam<fs::path> {};

TEST_P(BadGltf, GivesTheMessageThatItExpects) {
  std::ifstream stream(GetParam());
  const auto extras = nlohmann::json::parse(stream).at("asset").at("extras");
  const auto expect = extras.at("expect").get<std::string>();
  const auto scene = load_gltf({.file = GetParam()});
  if (extras.at("as") == "error") {
    ASSERT_FALSE(scene.has_value()) << "loaded; expected " << expect;
    EXPECT_EQ(scene.error().kind, ErrorKind::kInvalidInput);
    EXPECT_NE(scene.error().message.find(expect), std::string::npos) << scene.error().message;
    EXPECT_TRUE(scene.error().message.starts_with(GetParam().generic_string() + ": ")) << scene.error().message;
    EXPECT_EQ(scene.error().message.find('\n'), std::string::npos);
    return;
  }
  ASSERT_TRUE(scene.has_value()) << scene.error().message;
  const auto names_it = [&](const std::string& w) { return w.find(expect) != std::string::npos; };
  EXPECT_EQ(std::count_if(scene->warnings.begin(), scene->warnings.end(), names_it), 1)
      << testing::PrintToString(scene->warnings);
}

INSTANTIATE_TEST_SUITE_P(Corpus, BadGltf, testing::ValuesIn(bad_files()),
                         [](const auto& test) { return test.param.stem().string(); });

TEST(BadGltf, CorpusIsThere) { EXPECT_GE(bad_files().size(), 30u); }

}  // namespace
}  // namespace pf
