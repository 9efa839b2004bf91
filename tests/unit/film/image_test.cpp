#include "common/film/image.h"

#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>

#include <gtest/gtest.h>
#include <png.h>

#include "tests/support/paths.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

class ImageFile : public testing::Test {
 protected:
  [[nodiscard]] fs::path file(const char* name) const { return folder_ / name; }
  [[nodiscard]] std::size_t files() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder_), {}));
  }

  TempFolder temp_;
  const fs::path& folder_ = temp_.path();
};

void put_bytes(const fs::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

Layer make_layer(std::string name, std::vector<std::string> channels, int pixels) {
  Layer layer{std::move(name), std::move(channels), {}};
  for (std::size_t i = 0; i < layer.channels.size() * pixels; ++i) {
    layer.data.push_back(std::ldexp(static_cast<float>(i * 2654435761u % 65521u), static_cast<int>(i % 40) - 30));
  }
  return layer;
}

LayeredImage make_image(int width, int height) {
  LayeredImage image;
  image.width = width;
  image.height = height;
  image.layers.push_back(make_layer("", {"R", "G", "B"}, width * height));
  image.layers.push_back(make_layer("caustics", {"R", "G", "B", "A"}, width * height));
  image.layers.push_back(make_layer("deep.name", {"Z"}, width * height));
  image.metadata = {{"seed", "1"}, {"spec_hash", "00ff"}, {"plan", "ppm: a caustic is \"near\"\nsecond line"}};
  return image;
}

Result<void> write_beauty(const fs::path& file, int width, int height, const std::vector<Rgb>& beauty, float stops) {
  LayeredImage image{width, height, {{"", {"R", "G", "B"}, {}}}, {}};
  for (const Rgb& pixel : beauty) image.layers[0].data.insert(image.layers[0].data.end(), {pixel.x, pixel.y, pixel.z});
  const auto rows = [&](int first, int count) {
    std::vector<Layer> block = image.layers;
    const auto begin = std::size_t{3} * width * first;
    const auto end = std::min(begin + std::size_t{3} * width * count, block[0].data.size());
    block[0].data.assign(image.layers[0].data.begin() + static_cast<std::ptrdiff_t>(begin),
                         image.layers[0].data.begin() + static_cast<std::ptrdiff_t>(end));
    return block;
  };
  return write_png(file, {width, height, rows, {}}, stops);
}

/// Bits, so that NaN equals itself and -0 is not 0.
void expect_same(const LayeredImage& a, const LayeredImage& b) {
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  EXPECT_EQ(a.metadata, b.metadata);
  ASSERT_EQ(a.layers.size(), b.layers.size());
  for (std::size_t i = 0; i < a.layers.size(); ++i) {
    EXPECT_EQ(a.layers[i].name, b.layers[i].name);
    EXPECT_EQ(a.layers[i].channels, b.layers[i].channels);
    ASSERT_EQ(a.layers[i].data.size(), b.layers[i].data.size());
    EXPECT_EQ(std::memcmp(a.layers[i].data.data(), b.layers[i].data.data(), a.layers[i].data.size() * sizeof(float)),
              0);
  }
}

TEST_F(ImageFile, KeepsEveryBitOfLayersAndMetadata) {
  LayeredImage image = make_image(37, 300);
  float* data = image.layers[0].data.data();
  data[0] = std::numeric_limits<float>::quiet_NaN();
  data[1] = std::numeric_limits<float>::infinity();
  data[2] = -0.0f;
  data[3] = std::numeric_limits<float>::denorm_min();
  ASSERT_TRUE(write_exr(file("a.exr"), image));
  const auto read = read_exr(file("a.exr"));
  ASSERT_TRUE(read) << read.error().message;
  expect_same(*read, image);
  EXPECT_EQ(read->find("caustics")->channels.size(), 4u);
  EXPECT_EQ(read->find("no such layer"), nullptr);
}

TEST_F(ImageFile, GivesTheSameBytesForTheSameImage) {
  ASSERT_TRUE(write_exr(file("a.exr"), make_image(20, 20)));
  ASSERT_TRUE(write_exr(file("b.exr"), make_image(20, 20)));
  EXPECT_TRUE(bytes_of(file("a.exr")) == bytes_of(file("b.exr")));
}

TEST_F(ImageFile, RefusesLayersThatDoNotFit) {
  LayeredImage image = make_image(4, 4);
  image.layers[1].data.pop_back();
  EXPECT_EQ(write_exr(file("a.exr"), image).error().kind, ErrorKind::kInternal);
  image = make_image(4, 4);
  image.layers[1].name = "";
  EXPECT_NE(write_exr(file("a.exr"), image).error().message.find("'R' twice"), std::string::npos);
  image = make_image(4, 4);
  image.layers.clear();
  EXPECT_FALSE(write_exr(file("a.exr"), image));
  image = make_image(4, 4);
  image.width = 0;
  EXPECT_FALSE(write_exr(file("a.exr"), image));
  EXPECT_EQ(files(), 0u);
}

TEST_F(ImageFile, LeavesTheOldFileWhenTheDiskIsFull) {
  const LayeredImage old = make_image(2, 2);
  ASSERT_TRUE(write_exr(file("a.exr"), old));
  ASSERT_TRUE(write_beauty(file("a.png"), 1, 1, {Rgb(1.0f)}, 0.0f));
  const std::string before = bytes_of(file("a.png"));
  rlimit limits{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &limits), 0);
  auto* const handler = std::signal(SIGXFSZ, SIG_IGN);
  // 60 bytes: fails when the stream is closed; 20,000: in the middle of the pixels.
  for (const rlim_t most : {rlim_t{60}, rlim_t{20000}}) {
    const rlimit tight{most, limits.rlim_max};
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &tight), 0);
    const auto exr = write_exr(file("a.exr"), make_image(most < 100 ? 2 : 200, most < 100 ? 2 : 200));
    std::vector<Rgb> noise;
    for (unsigned i = 0; i < 40000; ++i) {
      noise.emplace_back(static_cast<float>(i * i * 2654435761u >> 8) / 16777216.0f, 0.5f, 0.25f);
    }
    const auto png = write_beauty(file("a.png"), 200, 200, noise, 0.0f);
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &limits), 0);
    ASSERT_FALSE(exr);
    EXPECT_EQ(exr.error().kind, ErrorKind::kInternal);
    EXPECT_NE(exr.error().message.find("a.exr"), std::string::npos) << exr.error().message;
    EXPECT_FALSE(png);
  }
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(files(), 2u);
  const auto read = read_exr(file("a.exr"));
  ASSERT_TRUE(read);
  expect_same(*read, old);
  EXPECT_TRUE(bytes_of(file("a.png")) == before);
}

TEST_F(ImageFile, NamesTheFileThatCannotBeRead) {
  fs::create_directory(file("folder.exr"));
  ASSERT_EQ(::mkfifo(file("pipe.exr").c_str(), 0600), 0);
  put_bytes(file("text.exr"), "not an image\n");
  put_bytes(file("empty.exr"), "");
  for (const char* name : {"absent.exr", "folder.exr", "pipe.exr", "text.exr", "empty.exr"}) {
    const auto read = read_exr(file(name));
    ASSERT_FALSE(read) << name;
    EXPECT_EQ(read.error().kind, ErrorKind::kInvalidInput);
    EXPECT_TRUE(read.error().message.starts_with(file(name).string() + ": ")) << read.error().message;
  }
}

TEST_F(ImageFile, RefusesAFileThatWasCutShortAnywhere) {
  ASSERT_TRUE(write_exr(file("a.exr"), make_image(9, 40)));
  const std::string whole = bytes_of(file("a.exr"));
  for (std::size_t length = 0; length < whole.size(); length += length < 1500 ? 5 : 61) {
    put_bytes(file("cut.exr"), whole.substr(0, length));
    EXPECT_FALSE(read_exr(file("cut.exr"))) << length << " of " << whole.size() << " bytes";
  }
}

TEST_F(ImageFile, SurvivesAnyByteChanged) {
  LayeredImage image = make_image(5, 20);
  ASSERT_TRUE(write_exr(file("a.exr"), image));
  const std::string whole = bytes_of(file("a.exr"));
  for (std::size_t i = 0; i < whole.size(); i += i < 900 ? 3 : 61) {
    for (const char value : {'\0', '\xff'}) {
      std::string damaged = whole;
      damaged[i] = value;
      put_bytes(file("damaged.exr"), damaged);
      const auto read = read_exr(file("damaged.exr"));
      EXPECT_TRUE(read || read.error().kind == ErrorKind::kInvalidInput);
    }
  }
}

// ---------------------------------------------------------------------------------------- published files

std::vector<fs::path> files_below(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code absent;
  for (const auto& entry : fs::recursive_directory_iterator(folder, absent)) {
    if (entry.is_regular_file()) found.push_back(entry.path());
  }
  std::ranges::sort(found);
  return found;
}

TEST(PublishedExr, EveryValidFileLoads) {
  const fs::path folder = test::shared_dir() / "scenes/exr";
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is absent";
  std::size_t loaded = 0;
  for (const fs::path& file : files_below(folder)) {
    if (file.extension() != ".exr") continue;
    const auto image = read_exr(file);
    ASSERT_TRUE(image) << image.error().message;
    ASSERT_FALSE(image->layers.empty());
    const Layer& layer = image->layers[0];
    EXPECT_EQ(layer.data.size(), layer.channels.size() * image->width * image->height) << file;
    ++loaded;
    std::size_t nonfinite = 0;
    for (const float value : layer.data) nonfinite += std::isfinite(value) ? 0 : 1;
    EXPECT_EQ(nonfinite > 0, file.stem() == "BrightRingsNanInf" || file.stem() == "AllHalfValues") << file;
  }
  EXPECT_GT(loaded, 10u);
}

TEST(PublishedExr, NoDamagedFileCrashesOrHangs) {
  const fs::path folder = test::shared_dir() / "scenes/invalid/exr";
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is absent";
  const std::vector<fs::path> files = files_below(folder);
  std::size_t refused = 0;
  for (const fs::path& file : files) {
    const auto start = std::chrono::steady_clock::now();
    const auto image = read_exr(file);
    if (!image) {
      EXPECT_EQ(image.error().kind, ErrorKind::kInvalidInput);
      ++refused;
    }
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20)) << file;
  }
  EXPECT_GT(refused, files.size() / 2);
}

// ---------------------------------------------------------------------------------------- PNG

struct Decoded {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb;
};

Decoded decode(const fs::path& file) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_file(&image, file.c_str()) == 0) return {};
  image.format = PNG_FORMAT_RGB;
  Decoded decoded{static_cast<int>(image.width), static_cast<int>(image.height), {}};
  decoded.rgb.resize(PNG_IMAGE_SIZE(image));
  if (png_image_finish_read(&image, nullptr, decoded.rgb.data(), 0, nullptr) == 0) return {};
  return decoded;
}

TEST_F(ImageFile, PngHoldsTheSrgbCurveAndSaysSo) {
  const std::vector<Rgb> beauty = {{0.0f, 0.5f, 1.0f}, {0.002f, 0.18f, 0.25f}};
  ASSERT_TRUE(write_beauty(file("a.png"), 1, 2, beauty, 0.0f));
  const Decoded decoded = decode(file("a.png"));
  EXPECT_EQ(decoded.width, 1);
  EXPECT_EQ(decoded.height, 2);
  EXPECT_EQ(decoded.rgb, (std::vector<std::uint8_t>{0, 188, 255, 7, 118, 137}));
  const std::string bytes = bytes_of(file("a.png"));
  EXPECT_NE(bytes.find("sRGB"), std::string::npos);
  EXPECT_NE(bytes.find("gAMA"), std::string::npos);
}

TEST_F(ImageFile, PngAppliesExposureInStops) {
  ASSERT_TRUE(write_beauty(file("a.png"), 2, 1, {Rgb(0.125f), Rgb(2.0f)}, 2.0f));
  EXPECT_EQ(decode(file("a.png")).rgb, (std::vector<std::uint8_t>{188, 188, 188, 255, 255, 255}));
}

TEST_F(ImageFile, PngShowsNanInMagentaAndClampsTheRest) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  ASSERT_TRUE(
      write_beauty(file("a.png"), 4, 1, {{nan, 0, 0}, {inf, -inf, -1}, {0, 0, -nan}, {1e38f, -0.0f, 1e-45f}}, 3));
  EXPECT_EQ(decode(file("a.png")).rgb, (std::vector<std::uint8_t>{255, 0, 255, 255, 0, 0, 255, 0, 255, 255, 0, 0}));
}

TEST_F(ImageFile, PngRefusesAWrongNumberOfPixels) {
  EXPECT_EQ(write_beauty(file("a.png"), 2, 2, {Rgb(0.0f)}, 0.0f).error().kind, ErrorKind::kInternal);
  EXPECT_FALSE(write_beauty(file("a.png"), 0, 0, {}, 0.0f));
  EXPECT_FALSE(write_beauty(folder_ / "absent" / "a.png", 1, 1, {Rgb(0.0f)}, 0.0f));
  EXPECT_EQ(files(), 0u);
}

TEST(RgbPixels, TakesColoursFromWhereverTheyAreAndGreyFromLuminance) {
  const auto colors = rgb_pixels({"x", {"A", "B", "G", "R"}, {1, 2, 3, 4, 5, 6, 7, 8}});
  ASSERT_TRUE(colors);
  EXPECT_EQ(*colors, (std::vector<Rgb>{{4, 3, 2}, {8, 7, 6}}));
  EXPECT_EQ(*rgb_pixels({"", {"Y"}, {3, 5}}), (std::vector<Rgb>{{3, 3, 3}, {5, 5, 5}}));
  EXPECT_NE(rgb_pixels({"n", {"X", "Y", "Z"}, {}}).error().message.find("X, Y, Z"), std::string::npos);
}

}  // namespace
}  // namespace pf
