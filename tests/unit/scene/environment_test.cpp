#include "worker/scene/environment.h"
#include "tests/support/paths.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "common/math/philox.h"
#include "common/math/sampling.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

/// A .hdr without run lengths: shared exponent bytes, row by row.
class HdrFile {
 public:
  HdrFile(int width, int height, const std::vector<std::array<unsigned char, 4>>& pixels) {
    std::ofstream stream(path_, std::ios::binary);
    stream << "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y " << height << " +X " << width << "\n";
    for (const auto& pixel : pixels) stream.write(reinterpret_cast<const char*>(pixel.data()), 4);
  }
  [[nodiscard]] std::string path() const { return path_.string(); }

 private:
  TempFolder folder_;
  std::filesystem::path path_ = folder_ / "environment.hdr";
};

EnvironmentMap load(const std::string& file, const Rgb& scale = Rgb(1.0f)) {
  std::vector<std::string> warnings;
  auto map = EnvironmentMap::load({file, scale}, warnings);
  EXPECT_TRUE(map) << map.error().message;
  return map ? *map : EnvironmentMap();
}

/// RGBE of small values: value = byte / 256 * 2^(e - 128); e = 129 gives byte / 128.
std::array<unsigned char, 4> rgbe(unsigned char r, unsigned char g, unsigned char b, unsigned char e = 129) {
  return {r, g, b, e};
}

TEST(Environment, ConstantRadianceIsAUniformSphere) {
  std::vector<std::string> warnings;
  const auto map = EnvironmentMap::load({"", Rgb(1, 2, 3)}, warnings);
  ASSERT_TRUE(map);
  EXPECT_TRUE(map->present());
  EXPECT_EQ(map->radiance(Vec3f(0, 1, 0)), Rgb(1, 2, 3));
  EXPECT_FLOAT_EQ(map->pdf_w(Vec3f(0, 1, 0)), 0.25f * kInvPi);
  EXPECT_FLOAT_EQ(map->total().y, 8.0f * kPi);
  EXPECT_FLOAT_EQ(map->sample(Vec2f(0.3f, 0.7f)).pdf_w, 0.25f * kInvPi);
  const auto none = EnvironmentMap::load({}, warnings);
  EXPECT_FALSE(none->present());
  EXPECT_EQ(none->sample(Vec2f(0.3f, 0.7f)).pdf_w, 0.0f);
  EXPECT_FALSE(EnvironmentMap().present());
}

TEST(Environment, LooksAlongMinusZInTheMiddleAndUpAtTheTop) {
  // 4 x 2 pixels, each with its own red.
  std::vector<std::array<unsigned char, 4>> pixels;
  for (unsigned char i = 0; i < 8; ++i) pixels.push_back(rgbe(static_cast<unsigned char>(128 + 8 * i), 0, 0));
  const HdrFile file(4, 2, pixels);
  const EnvironmentMap map = load(file.path());
  const auto column = [&](float x, float y, float z) {
    return static_cast<int>(std::lround((map.radiance(normalize(Vec3f(x, y, z))).x * 128.0f - 128.0f) / 8.0f));
  };
  // u = 0 and 1 look along +z, 0.25 along -x, 0.5 along -z, 0.75 along +x.
  EXPECT_EQ(column(-1.0f, 1.0f, 1.0f), 0);
  EXPECT_EQ(column(-1.0f, 1.0f, -1.0f), 1);
  EXPECT_EQ(column(1.0f, 1.0f, -1.0f), 2);
  EXPECT_EQ(column(1.0f, 1.0f, 1.0f), 3);
  EXPECT_EQ(column(-1.0f, -0.1f, 1.0f), 4);
  EXPECT_EQ(column(1.0f, -0.1f, 1.0f), 7);
}

/// Integrates radiance and pdf over the sphere by a fine grid of cell centres, and checks sample() against
/// both.
void check_consistency(const EnvironmentMap& map, int samples) {
  constexpr int kTheta = 64, kPhi = 128;
  constexpr int kFine = 4;  // sub-cells along each axis
  std::vector<double> expected(kTheta * kPhi, 0.0);
  double pdf_sum = 0.0;
  Imath::V3d total(0.0);
  for (int t = 0; t < kTheta * kFine; ++t) {
    for (int f = 0; f < kPhi * kFine; ++f) {
      const double low = std::cos(M_PI * t / (kTheta * kFine)), high = std::cos(M_PI * (t + 1) / (kTheta * kFine));
      const double theta = M_PI * (t + 0.5) / (kTheta * kFine), phi = 2.0 * M_PI * (f + 0.5) / (kPhi * kFine);
      const Vec3f d(static_cast<float>(std::sin(theta) * std::sin(phi)), static_cast<float>(std::cos(theta)),
                    static_cast<float>(-std::sin(theta) * std::cos(phi)));
      const double solid_angle = (low - high) * 2.0 * M_PI / (kPhi * kFine);
      const double p = static_cast<double>(map.pdf_w(d)) * solid_angle;
      expected[static_cast<std::size_t>(t / kFine * kPhi + f / kFine)] += p;
      pdf_sum += p;
      total += Imath::V3d(map.radiance(d)) * solid_angle;
    }
  }
  EXPECT_NEAR(pdf_sum, 1.0, 2e-3);
  EXPECT_NEAR(total.x / static_cast<double>(map.total().x), 1.0, 2e-3);

  PathRng rng(3, Stream::kTest, 0, 0);
  std::vector<double> counts(expected.size(), 0.0);
  Imath::V3d estimate(0.0);
  for (int i = 0; i < samples; ++i) {
    const auto s = map.sample(rng.next2());
    ASSERT_GT(s.pdf_w, 0.0f);
    ASSERT_NEAR(length(s.direction), 1.0f, 1e-5f);
    ASSERT_EQ(s.pdf_w, map.pdf_w(s.direction));
    ASSERT_EQ(s.radiance, map.radiance(s.direction));
    estimate += Imath::V3d(s.radiance) / static_cast<double>(s.pdf_w) / samples;
    const double theta = std::acos(std::clamp(static_cast<double>(s.direction.y), -1.0, 1.0));
    double phi = std::atan2(static_cast<double>(s.direction.x), static_cast<double>(-s.direction.z));
    if (phi < 0.0) phi += 2.0 * M_PI;
    const int t = std::min(static_cast<int>(theta / M_PI * kTheta), kTheta - 1);
    const int f = std::min(static_cast<int>(phi / (2.0 * M_PI) * kPhi), kPhi - 1);
    counts[static_cast<std::size_t>(t * kPhi + f)] += 1.0;
  }
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(estimate[c] / static_cast<double>(map.total()[c]), 1.0, 0.02);
  double chi2 = 0.0;
  int cells = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const double mean = expected[i] * samples;
    if (mean < 10.0) continue;
    chi2 += (counts[i] - mean) * (counts[i] - mean) / mean;
    ++cells;
  }
  ASSERT_GT(cells, 50);
  EXPECT_LT(chi2, cells + 6.0 * std::sqrt(2.0 * cells));  // six standard deviations of chi-square
}

TEST(Environment, SamplesDensitiesAndTotalOfAMapAgree) {
  // 16 x 8: one very bright pixel, some black, the poles included. All pixels align with the test's cells.
  std::vector<std::array<unsigned char, 4>> pixels;
  for (int i = 0; i < 128; ++i) {
    pixels.push_back(i == 37 ? rgbe(255, 250, 240, 133)
                             : (i % 5 == 0 ? rgbe(0, 0, 0, 0) : rgbe(static_cast<unsigned char>(i), 130, 200)));
  }
  const HdrFile file(16, 8, pixels);
  check_consistency(load(file.path(), Rgb(2.0f, 1.0f, 0.5f)), 200000);
}

TEST(Environment, EveryRandomNumberGivesADirectionThatEvaluationFindsAgain) {
  std::vector<std::array<unsigned char, 4>> pixels(8 * 4, rgbe(0, 0, 0, 0));
  pixels[3] = rgbe(200, 100, 50);
  pixels[20] = rgbe(20, 100, 250);
  const HdrFile file(8, 4, pixels);
  const EnvironmentMap map = load(file.path());
  for (const float x : {0.0f, 1e-7f, 0.25f, 0.5f, 0.75f, 0x1.fffffep-1f}) {
    for (const float y : {0.0f, 1e-7f, 0.25f, 0.5f, 0.75f, 0x1.fffffep-1f}) {
      const auto s = map.sample(Vec2f(x, y));
      EXPECT_GT(s.pdf_w, 0.0f);
      EXPECT_EQ(s.pdf_w, map.pdf_w(s.direction));
      EXPECT_EQ(s.radiance, map.radiance(s.direction));
    }
  }
}

TEST(Environment, ReadsTheTestMaps) {
  const std::filesystem::path folder = test::shared_dir() / "scenes/env";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no test maps";
  for (const char* name : {"royal_esplanade_256/royal_esplanade_256.hdr", "royal_esplanade_1k/royal_esplanade_1k.hdr",
                           "chinese_garden_1k/chinese_garden_1k.hdr", "KernerEnvLatLong/KernerEnvLatLong.exr"}) {
    SCOPED_TRACE(name);
    const EnvironmentMap map = load((folder / name).string());
    EXPECT_TRUE(map.present());
    EXPECT_TRUE(is_finite(map.total()));
    PathRng rng(5, Stream::kTest, 0, 0);
    double estimate = 0.0, square = 0.0;
    constexpr int kSamples = 20000;
    for (int i = 0; i < kSamples; ++i) {
      const auto s = map.sample(rng.next2());
      ASSERT_EQ(s.pdf_w, map.pdf_w(s.direction));
      ASSERT_EQ(s.radiance, map.radiance(s.direction));
      const double x = static_cast<double>(average(s.radiance) / s.pdf_w);
      estimate += x / kSamples;
      square += x * x / kSamples;
    }
    const double deviation = std::sqrt((square - estimate * estimate) / kSamples);
    EXPECT_NEAR(estimate, static_cast<double>(average(map.total())), 5.0 * deviation + 1e-4 * estimate);
  }
}

TEST(Environment, DecodesRunLengthsOfAnEightPixelMap) {
  const std::string file = (test::shared_dir() / "scenes/env/simple-rle/simple-rle.hdr").string();
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no test maps";
  const EnvironmentMap map = load(file);
  // First row: runs of (255, 0, 136, 129): 255/128, 0, 136/128. Second row: r = 0..7, g = 10, b = 20, e =
  // 128.
  const Rgb top = map.radiance(normalize(Vec3f(0.3f, 1.0f, -0.1f)));
  EXPECT_GT(top.x, 0.0f);
  EXPECT_GT(top.x, top.y);
  const Rgb below_left = map.radiance(normalize(Vec3f(-0.1f, -1.0f, 1.0f)));
  const Rgb below_right = map.radiance(normalize(Vec3f(0.1f, -1.0f, 1.0f)));
  EXPECT_LT(below_left.x, below_right.x);
  EXPECT_FLOAT_EQ(below_left.y, below_right.y);
}

TEST(Environment, NamesTheFileThatItCannotRead) {
  std::vector<std::string> warnings;
  const auto expect_error = [&](const std::string& file) {
    const auto map = EnvironmentMap::load({file, Rgb(1.0f)}, warnings);
    ASSERT_FALSE(map);
    EXPECT_EQ(map.error().kind, ErrorKind::kInvalidInput);
    EXPECT_EQ(map.error().message.rfind(file, 0), 0u) << map.error().message;
  };
  expect_error("no-such-file.hdr");
  const HdrFile short_file(64, 32, {rgbe(1, 2, 3)});
  expect_error(short_file.path());
  const HdrFile huge(1 << 20, 1 << 20, {rgbe(1, 2, 3)});
  expect_error(huge.path());
  const TempFolder folder;
  const std::string text = (folder / "text.hdr").string();
  std::ofstream(text) << "not an image";
  expect_error(text);
}

TEST(Environment, TakesNonFiniteAndNegativePixelsAsBlackAndSaysSo) {
  const std::string file = (test::shared_dir() / "scenes/exr/TestImages/BrightRingsNanInf.exr").string();
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no test images";
  std::vector<std::string> warnings;
  const auto map = EnvironmentMap::load({file, Rgb(1.0f)}, warnings);
  ASSERT_TRUE(map) << map.error().message;
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0].rfind(file, 0), 0u);
  EXPECT_TRUE(is_finite(map->total()));
}

TEST(Environment, SurvivesDamagedExrFiles) {
  const std::filesystem::path folder = test::shared_dir() / "scenes/invalid/exr";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no damaged files";
  int files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    ++files;
    std::vector<std::string> warnings;
    const auto map = EnvironmentMap::load({entry.path().string(), Rgb(1.0f)}, warnings);
    if (!map) {
      EXPECT_EQ(map.error().kind, ErrorKind::kInvalidInput);
    }
  }
  EXPECT_GT(files, 0);
}

}  // namespace
}  // namespace pf
