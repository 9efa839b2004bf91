// A bundle whose small files promise huge images: refused with a clear error, by the renderer and by the
// farm, which goes on.

#include <array>
#include <fstream>
#include <sstream>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "jobs/command.h"
#include "jobs/process.h"
#include "tests/farm/farm_fixture.h"
#include "tests/support/paths.h"

namespace pf::farm_test {
namespace {

namespace fs = std::filesystem;

std::string big_endian(std::uint32_t value) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift & 0xFF);
  return bytes;
}

std::string chunk(const std::string& type, const std::string& data) {
  return big_endian(static_cast<std::uint32_t>(data.size())) + type + data +
         std::string(4, '\0');  // sizes come before checksums
}

/// Some twenty bytes of data that promise so many pixels of 16-bit RGBA.
std::string bomb_png(std::uint32_t side) {
  return "\x89PNG\r\n\x1A\n" + chunk("IHDR", big_endian(side) + big_endian(side) + std::string("\x10\x06\0\0\0", 5)) +
         chunk("IDAT", std::string("\x78\xDA\x63\0\0\0\x01\0\x01", 9)) + chunk("IEND", "");
}

constexpr const char* kScene = R"({
  "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
  "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0, 3]}],
  "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
  "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
  "materials": [{"emissiveFactor": [1, 1, 1], "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
  "textures": [{"source": 0}], "images": [{"uri": "bomb.png"}],
  "buffers": [{"uri": "scene.bin", "byteLength": 60}],
  "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
  "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1, 0]},
                {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}]})";

class Oversized : public FarmFaults {
 protected:
  [[nodiscard]] fs::path job_with(const std::string& image) const {
    const fs::path folder = folder_.path() / "bomb";
    fs::create_directories(folder);
    const std::array<float, 15> numbers = {-1, -1, 0, 1, -1, 0, 0, 1, 0, 0, 0, 1, 0, 0.5f, 1};
    std::ofstream(folder / "scene.bin", std::ios::binary)
        .write(reinterpret_cast<const char*>(numbers.data()), sizeof numbers);
    std::ofstream(folder / "scene.gltf") << kScene;
    std::ofstream(folder / "bomb.png", std::ios::binary) << image;
    std::ofstream(folder / "job.toml")
        << "spec_version = 1\n[job]\nname = \"bomb\"\n[scene]\nfile = \"scene.gltf\"\n"
           "[image]\nwidth = 16\nheight = 16\n[integrator]\ntype = \"path\"\n[stop]\npasses = 4\n";
    return folder / "job.toml";
  }
  /// Most memory that the worker has held so far [bytes].
  [[nodiscard]] std::uint64_t peak_of_worker() const {
    const std::string status = read_file(fmt::format("/proc/{}/status", workers_.at(1).pid()), 1 << 16).value_or("");
    const std::size_t at = status.find("VmHWM:");
    return at == std::string::npos ? 0 : std::stoull(status.substr(at + 6)) * 1024;
  }
};

TEST_F(Oversized, ATextureThatPromisesTooMuchFailsItsJobAndNothingElse) {
  start_farm(1);
  struct Case {
    std::uint32_t side;
    const char* says;
  };
  for (const auto& [side, says] :
       {Case{100000, "image is 100000 x 100000 pixels; at most 16384 x 16384 are supported"},
        Case{16000, "image is 16000 x 16000 pixels, more than its 9 bytes of data can hold"}}) {
    const fs::path job = job_with(bomb_png(side));
    std::ostringstream out, err;
    const Context context{test::bin_dir(), "/usr/bin:/bin", state_, folder_.path(), out, err};
    EXPECT_EQ(run_photonfarm(context, {"submit", job.string(), "--wait", "--out", folder_.path().string()}), 5)
        << err.str();
    EXPECT_NE(err.str().find(says), std::string::npos) << err.str();
    EXPECT_NE(err.str().find("bomb.png"), std::string::npos) << err.str();
    EXPECT_EQ(err.str().find("cache"), std::string::npos) << "where a worker keeps its files: " << err.str();
    const auto rendered = run_and_capture(test::bin_dir() / "photonfarm-worker",
                                          {"render", job.string(), "--out", folder_.path().string()}, kStuck);
    ASSERT_TRUE(rendered);
    EXPECT_EQ(rendered->end.exit_code, 3) << side;
  }
  EXPECT_FALSE(workers_.at(1).end()) << "the worker lives";
  EXPECT_GT(peak_of_worker(), 0u);
  EXPECT_LT(peak_of_worker(), std::uint64_t{1} << 30) << "and took no memory for what the headers promised";
  TestJob next;
  next.passes = 4;
  next.photons = 2000;
  expect_the_single_nodes_image(submit(next), next);
}

}  // namespace
}  // namespace pf::farm_test
