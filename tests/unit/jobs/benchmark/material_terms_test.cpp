#include "jobs/benchmark/material_terms.h"

#include <cstring>
#include <filesystem>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"
#include "tests/support/temp_folder.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

const json kDocument = json::parse(R"({
  "asset": {"version": "2.0"},
  "materials": [
    {"name": "all", "alphaMode": "MASK", "normalTexture": {"index": 0}, "emissiveTexture": {"index": 1},
     "pbrMetallicRoughness": {"baseColorTexture": {"index": 2}, "roughnessFactor": 0.5, "metallicFactor": 1},
     "extensions": {"KHR_materials_volume": {"attenuationColor": [1, 0.5, 0.5], "attenuationDistance": 2}}},
    {"name": "lambert", "pbrMetallicRoughness": {"roughnessFactor": 1, "metallicFactor": 0},
     "extensions": {"KHR_materials_specular": {"specularFactor": 0}}},
    {"name": "bare"}]})");

std::string glb_of(const std::string& text, const std::string& binary) {
  const auto word = [](std::size_t value) {
    std::string bytes(4, '\0');
    const auto narrow = static_cast<std::uint32_t>(value);
    std::memcpy(bytes.data(), &narrow, 4);
    return bytes;
  };
  const std::string padded = text + std::string((4 - text.size() % 4) % 4, ' ');
  const std::string chunks =
      word(padded.size()) + "JSON" + padded + word(binary.size()) + std::string("BIN\0", 4) + binary;
  return "glTF" + word(2) + word(12 + chunks.size()) + chunks;
}

class MaterialTerms : public testing::Test {
 protected:
  json without(const std::string& term) {
    const fs::path file = temp_.path() / "scene.gltf";
    EXPECT_TRUE(write_file_atomically(file, kDocument.dump()));
    const auto done = leave_out_of_materials(term, file);
    EXPECT_TRUE(done) << done.error().message;
    return json::parse(*read_file(file, 1 << 20))["materials"];
  }
  TempFolder temp_;
};

TEST_F(MaterialTerms, EachTakesOutItsOwnAlone) {
  json expected = kDocument["materials"];
  expected[0].erase("normalTexture");
  EXPECT_EQ(without("normal maps"), expected);
  expected = kDocument["materials"];
  expected[0].erase("alphaMode");
  EXPECT_EQ(without("alpha"), expected);
  expected = kDocument["materials"];
  expected[0].erase("emissiveTexture");
  expected[0]["pbrMetallicRoughness"].erase("baseColorTexture");
  EXPECT_EQ(without("textures"), expected);
  expected = kDocument["materials"];
  expected[0]["extensions"]["KHR_materials_volume"].erase("attenuationColor");
  EXPECT_EQ(without("absorption"), expected);
  expected = kDocument["materials"];
  expected[0]["pbrMetallicRoughness"]["roughnessFactor"] = 0;
  expected[2]["pbrMetallicRoughness"]["roughnessFactor"] = 0;  // glTF's own default is rough metal
  EXPECT_EQ(without("rough lobes"), expected);
  EXPECT_FALSE(is_material_term("environment"));
}

TEST_F(MaterialTerms, OfAGlbKeepItsBinaryChunkAndItsLengths) {
  const fs::path file = temp_.path() / "scene.glb";
  const std::string binary = "twelve bytes";
  ASSERT_TRUE(write_file_atomically(file, glb_of(kDocument.dump(), binary)));
  const auto done = leave_out_of_materials("absorption", file);
  ASSERT_TRUE(done) << done.error().message;
  json expected = kDocument;
  expected["materials"][0]["extensions"]["KHR_materials_volume"].erase("attenuationColor");
  EXPECT_EQ(*read_file(file, 1 << 20), glb_of(expected.dump(), binary));
}

TEST_F(MaterialTerms, OfWhatIsNoGltfAreRefused) {
  const fs::path file = temp_.path() / "scene.glb";
  std::string cut = glb_of(kDocument.dump(), "");
  cut.resize(40);
  for (const std::string& bytes : {std::string("no JSON"), cut, std::string("glTF"), std::string("[1]")}) {
    ASSERT_TRUE(write_file_atomically(file, bytes));
    const auto done = leave_out_of_materials("alpha", file);
    ASSERT_FALSE(done) << bytes;
    EXPECT_EQ(done.error().kind, ErrorKind::kInvalidInput);
  }
  EXPECT_FALSE(leave_out_of_materials("alpha", temp_.path() / "missing.glb"));
}

}  // namespace
}  // namespace pf::bench
