#include "worker/scene/texture_store.h"

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include "common/math/philox.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

using Bytes = std::vector<std::uint8_t>;

// 2 x 2, 2 bits: opaque red, green with alpha 128; blue with alpha 0, grey 128 with alpha 64.
const Bytes kPalettePng = {
    0x89, 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A, 0x00, 0x00, 0x00, 0x0D, 0x49, 0x48, 0x44, 0x52, 0x00, 0x00, 0x00,
    0x02, 0x00, 0x00, 0x00, 0x02, 0x02, 0x03, 0x00, 0x00, 0x00, 0x0F, 0xD8, 0xE5, 0xB7, 0x00, 0x00, 0x00, 0x0C, 0x50,
    0x4C, 0x54, 0x45, 0xFF, 0x00, 0x00, 0x00, 0xFF, 0x00, 0x00, 0x00, 0xFF, 0x80, 0x80, 0x80, 0xCC, 0xB0, 0x46, 0x0F,
    0x00, 0x00, 0x00, 0x04, 0x74, 0x52, 0x4E, 0x53, 0xFF, 0x80, 0x00, 0x40, 0xFA, 0x7F, 0x3A, 0x7B, 0x00, 0x00, 0x00,
    0x0C, 0x49, 0x44, 0x41, 0x54, 0x78, 0xDA, 0x63, 0x10, 0x60, 0xD8, 0x00, 0x00, 0x00, 0xE4, 0x00, 0xC1, 0x19, 0x55,
    0x3B, 0xFB, 0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4E, 0x44, 0xAE, 0x42, 0x60, 0x82,
};
// 4 x 1, 1 bit: black, white, black, white.
const Bytes kOneBitPng = {
    0x89, 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A, 0x00, 0x00, 0x00, 0x0D, 0x49, 0x48, 0x44, 0x52, 0x00,
    0x00, 0x00, 0x04, 0x00, 0x00, 0x00, 0x01, 0x01, 0x00, 0x00, 0x00, 0x00, 0xD1, 0x47, 0x32, 0x60, 0x00,
    0x00, 0x00, 0x0A, 0x49, 0x44, 0x41, 0x54, 0x78, 0xDA, 0x63, 0x08, 0x00, 0x00, 0x00, 0x52, 0x00, 0x51,
    0x5A, 0xA9, 0xA3, 0x3A, 0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4E, 0x44, 0xAE, 0x42, 0x60, 0x82,
};
// Promises 100000 x 100000 pixels.
const Bytes kHugePng = {
    0x89, 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A, 0x00, 0x00, 0x00, 0x0D, 0x49, 0x48, 0x44, 0x52, 0x00,
    0x01, 0x86, 0xA0, 0x00, 0x01, 0x86, 0xA0, 0x08, 0x02, 0x00, 0x00, 0x00, 0x27, 0x30, 0x9C, 0x9F, 0x00,
    0x00, 0x00, 0x09, 0x49, 0x44, 0x41, 0x54, 0x78, 0xDA, 0x63, 0x00, 0x00, 0x00, 0x01, 0x00, 0x01, 0xB1,
    0x0D, 0xB6, 0x93, 0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4E, 0x44, 0xAE, 0x42, 0x60, 0x82,
};

/// Encodes 8 or 16-bit pixels.
template <typename T>
Bytes encode(const char* plugin, int width, int height, int channels, const std::vector<T>& pixels) {
  Bytes bytes;
  OIIO::Filesystem::IOVecOutput out(bytes);
  const auto output = OIIO::ImageOutput::create(plugin);
  OIIO::ImageSpec spec(width, height, channels, sizeof(T) == 2 ? OIIO::TypeUInt16 : OIIO::TypeUInt8);
  spec.attribute("oiio:UnassociatedAlpha", 1);
  spec.attribute("CompressionQuality", 100);
  spec.attribute("jpeg:subsampling", "4:4:4");
  EXPECT_TRUE(output->set_ioproxy(&out));
  EXPECT_TRUE(output->open("memory", spec)) << output->geterror();
  EXPECT_TRUE(output->write_image(spec.format, pixels.data())) << output->geterror();
  output->close();
  return bytes;
}

Texture texture(const Bytes& bytes, ColorSpace space = ColorSpace::kLinear, Wrap wrap = Wrap::kRepeat,
                bool nearest = false) {
  Texture t;
  t.name = "image 3 \"wood\"";
  t.bytes = std::make_shared<const Bytes>(bytes);
  t.wrap_s = t.wrap_t = wrap;
  t.nearest = nearest;
  t.color_space = space;
  return t;
}

TextureStore open(const std::vector<Texture>& textures, std::size_t megabytes = 256) {
  auto store = TextureStore::open(textures, megabytes);
  EXPECT_TRUE(store) << store.error().message;
  return std::move(*store);
}

void expect_near(const Vec4f& a, const Vec4f& b, float tolerance = 1e-6f) {
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(a[i], b[i], tolerance) << "channel " << i;
}

constexpr float kSrgb128 = 0.2158605f;  // ((128/255 + 0.055) / 1.055)^2.4

TEST(TextureStore, ReadsEveryKindOfPng) {
  const std::vector<Texture> textures = {
      texture(encode<std::uint8_t>("png", 1, 1, 1, {128}), ColorSpace::kSrgb),
      texture(encode<std::uint8_t>("png", 1, 1, 2, {128, 51}), ColorSpace::kSrgb),
      texture(encode<std::uint8_t>("png", 1, 1, 3, {0, 128, 255})),
      texture(encode<std::uint8_t>("png", 1, 1, 4, {128, 255, 0, 51}), ColorSpace::kSrgb),
      texture(encode<std::uint16_t>("png", 1, 1, 3, {257, 1, 65535})),
      texture(encode<std::uint16_t>("png", 1, 1, 4, {0, 128 * 257, 65535, 13107}), ColorSpace::kSrgb)};
  const TextureStore store = open(textures);
  const Vec2f uv(0.5f, 0.5f);
  expect_near(store.lookup(0, uv), {kSrgb128, kSrgb128, kSrgb128, 1.0f});
  expect_near(store.lookup(1, uv), {kSrgb128, kSrgb128, kSrgb128, 0.2f});
  expect_near(store.lookup(2, uv), {0.0f, 128.0f / 255.0f, 1.0f, 1.0f});
  expect_near(store.lookup(3, uv), {kSrgb128, 1.0f, 0.0f, 0.2f});  // not multiplied by alpha
  expect_near(store.lookup(4, uv), {1.0f / 255.0f, 1.0f / 65535.0f, 1.0f, 1.0f});
  expect_near(store.lookup(5, uv), {0.0f, kSrgb128, 1.0f, 0.2f});
  EXPECT_FALSE(store.empty());
  EXPECT_TRUE(open({}).empty());
}

TEST(TextureStore, ReadsPalettesWithTransparencyAndSingleBits) {
  const TextureStore store = open({texture(kPalettePng, ColorSpace::kLinear, Wrap::kClamp, true),
                                   texture(kOneBitPng, ColorSpace::kLinear, Wrap::kClamp, true)});
  expect_near(store.lookup(0, {0.25f, 0.25f}), {1, 0, 0, 1});
  expect_near(store.lookup(0, {0.75f, 0.25f}), {0, 1, 0, 128.0f / 255.0f});
  expect_near(store.lookup(0, {0.25f, 0.75f}), {0, 0, 1, 0});
  expect_near(store.lookup(0, {0.75f, 0.75f}), {128.0f / 255.0f, 128.0f / 255.0f, 128.0f / 255.0f, 64.0f / 255.0f});
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(store.lookup(1, {(static_cast<float>(i) + 0.5f) / 4.0f, 0.5f}).x, static_cast<float>(i % 2));
  }
}

TEST(TextureStore, ReadsJpeg) {
  const Bytes jpeg = encode<std::uint8_t>("jpeg", 16, 16, 3, std::vector<std::uint8_t>(16 * 16 * 3, 128));
  const TextureStore store = open({texture(jpeg), texture(encode<std::uint8_t>("jpeg", 8, 8, 1, Bytes(64, 200)))});
  expect_near(store.lookup(0, {0.4f, 0.6f}), Vec4f(128.0f / 255.0f, 128.0f / 255.0f, 128.0f / 255.0f, 1.0f), 0.005f);
  expect_near(store.lookup(1, {0.4f, 0.6f}), Vec4f(200.0f / 255.0f, 200.0f / 255.0f, 200.0f / 255.0f, 1.0f), 0.005f);
}

TEST(TextureStore, TexelCentresLieAtHalvesAndTheFirstRowIsOnTop) {
  // 3 x 2 greys.
  const Bytes png = encode<std::uint8_t>("png", 3, 2, 1, {0, 51, 102, 153, 204, 255});
  const TextureStore store = open({texture(png)});
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 3; ++x) {
      const Vec2f uv((static_cast<float>(x) + 0.5f) / 3.0f, (static_cast<float>(y) + 0.5f) / 2.0f);
      EXPECT_NEAR(store.lookup(0, uv).x, 0.2f * static_cast<float>(3 * y + x), 1e-6f);
    }
  }
  EXPECT_NEAR(store.lookup(0, {0.5f, 0.5f}).x, 0.5f, 1e-6f);  // between rows
  EXPECT_NEAR(store.lookup(0, {1.0f / 3.0f, 0.25f}).x, 0.1f, 1e-6f);
}

TEST(TextureStore, FiltersInLinearLight) {
  const TextureStore store = open({texture(encode<std::uint8_t>("png", 2, 1, 1, {0, 255}), ColorSpace::kSrgb)});
  EXPECT_NEAR(store.lookup(0, {0.5f, 0.5f}).x, 0.5f, 1e-6f);
  const TextureStore alpha = open({texture(encode<std::uint8_t>("png", 2, 1, 2, {0, 128, 255, 0}), ColorSpace::kSrgb)});
  EXPECT_NEAR(alpha.lookup(0, {0.5f, 0.5f}).w, 64.0f / 255.0f, 1e-6f);
}

/// The definition, texel by texel.
float reference(const std::vector<std::uint8_t>& pixels, int width, int height, Wrap wrap, bool nearest, float u,
                float v) {
  const auto fold = [&](long i, long n) {
    if (wrap == Wrap::kClamp) return std::clamp(i, 0L, n - 1);
    if (wrap == Wrap::kRepeat) return ((i % n) + n) % n;
    const long m = ((i % (2 * n)) + 2 * n) % (2 * n);
    return m < n ? m : 2 * n - 1 - m;
  };
  const auto at = [&](long x, long y) {
    return static_cast<double>(pixels[static_cast<std::size_t>(fold(y, height) * width + fold(x, width))]) / 255.0;
  };
  const double x = static_cast<double>(u) * width, y = static_cast<double>(v) * height;
  if (nearest) return static_cast<float>(at(std::lround(std::floor(x)), std::lround(std::floor(y))));
  const double fx = std::floor(x - 0.5), fy = std::floor(y - 0.5);
  const double wx = x - 0.5 - fx, wy = y - 0.5 - fy;
  const long ix = static_cast<long>(fx), iy = static_cast<long>(fy);
  return static_cast<float>((at(ix, iy) * (1 - wx) + at(ix + 1, iy) * wx) * (1 - wy) +
                            (at(ix, iy + 1) * (1 - wx) + at(ix + 1, iy + 1) * wx) * wy);
}

TEST(TextureStore, WrapsLikeTheDefinitionOnBothAxes) {
  constexpr int kWidth = 5, kHeight = 7;
  PathRng rng(1, Stream::kTest, 0, 0);
  std::vector<std::uint8_t> pixels(kWidth * kHeight);
  for (auto& p : pixels) p = static_cast<std::uint8_t>(256.0f * rng.next1());
  const Bytes png = encode<std::uint8_t>("png", kWidth, kHeight, 1, pixels);
  std::vector<Texture> textures;
  std::vector<std::pair<Wrap, bool>> kinds;
  for (const Wrap wrap : {Wrap::kRepeat, Wrap::kMirror, Wrap::kClamp}) {
    for (const bool nearest : {false, true}) {
      textures.push_back(texture(png, ColorSpace::kLinear, wrap, nearest));
      kinds.emplace_back(wrap, nearest);
    }
  }
  const TextureStore store = open(textures);
  for (int i = 0; i < 5000; ++i) {
    const Vec2f uv(8.0f * rng.next1() - 4.0f, 8.0f * rng.next1() - 4.0f);
    for (std::size_t t = 0; t < kinds.size(); ++t) {
      const auto [wrap, nearest] = kinds[t];
      // Positions within rounding of a texel's border may fall to either side.
      const float x = uv.x * kWidth, y = uv.y * kHeight;
      if (nearest && (std::abs(x - std::round(x)) < 1e-4f || std::abs(y - std::round(y)) < 1e-4f)) continue;
      ASSERT_NEAR(store.lookup(static_cast<int>(t), uv).x,
                  reference(pixels, kWidth, kHeight, wrap, nearest, uv.x, uv.y), 2e-5f)
          << "u " << uv.x << " v " << uv.y << " kind " << t;
    }
  }
}

TEST(TextureStore, SurvivesEveryCoordinate) {
  const Bytes png = encode<std::uint8_t>("png", 3, 2, 3, Bytes(18, 77));
  std::vector<Texture> textures;
  for (const Wrap wrap : {Wrap::kRepeat, Wrap::kMirror, Wrap::kClamp}) {
    textures.push_back(texture(png, ColorSpace::kLinear, wrap));
    textures.push_back(texture(png, ColorSpace::kLinear, wrap, true));
  }
  const TextureStore store = open(textures);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const float u : {nan, kInfinity, -kInfinity, 1e30f, -1e30f, 1e-40f, -1e-40f, 1.0f, -1.0f, 2.0f, 0.99999994f}) {
    for (std::size_t t = 0; t < textures.size(); ++t) {
      EXPECT_NEAR(store.lookup(static_cast<int>(t), {u, 0.5f}).x, 77.0f / 255.0f, 1e-6f);
      EXPECT_NEAR(store.lookup(static_cast<int>(t), {0.5f, u}).x, 77.0f / 255.0f, 1e-6f);
    }
  }
}

TEST(TextureStore, GivesTheSameTexelsFromAMappedFileAsFromMemory) {
  constexpr int kSize = 37;
  PathRng rng(2, Stream::kTest, 0, 0);
  Bytes pixels(kSize * kSize * 4);
  for (auto& p : pixels) p = static_cast<std::uint8_t>(256.0f * rng.next1());
  const Texture t = texture(encode<std::uint8_t>("png", kSize, kSize, 4, pixels), ColorSpace::kSrgb);
  const TextureStore memory = open({t}, 256), mapped = open({t}, 0);
  for (int i = 0; i < 2000; ++i) {
    const Vec2f uv = rng.next2();
    ASSERT_EQ(memory.lookup(0, uv), mapped.lookup(0, uv));
  }
}

TEST(TextureStore, NamesTheImageThatItCannotRead) {
  Bytes png = encode<std::uint8_t>("png", 64, 64, 3, [] {
    PathRng rng(3, Stream::kTest, 0, 0);
    Bytes noise(64 * 64 * 3);
    for (auto& p : noise) p = static_cast<std::uint8_t>(256.0f * rng.next1());
    return noise;
  }());
  const auto expect_error = [](Bytes bytes, const std::string& what) {
    const Texture good = texture(kPalettePng);
    const auto store = TextureStore::open({good, texture(bytes)});
    ASSERT_FALSE(store) << what;
    EXPECT_EQ(store.error().kind, ErrorKind::kInvalidInput) << what;
    EXPECT_EQ(store.error().message.rfind("image 3 \"wood\": ", 0), 0u) << store.error().message;
  };
  const auto cut = [](Bytes bytes, double share) {
    bytes.resize(static_cast<std::size_t>(static_cast<double>(bytes.size()) * share));
    return bytes;
  };
  const Bytes jpeg = encode<std::uint8_t>("jpeg", 64, 64, 3, Bytes(64 * 64 * 3, 99));
  for (const double share : {0.01, 0.3, 0.6, 0.95}) {
    expect_error(cut(png, share), "truncated PNG");
    expect_error(cut(jpeg, share), "truncated JPEG");
  }
  Bytes flipped = png;
  flipped[flipped.size() / 2] ^= 0xFF;
  expect_error(flipped, "PNG with a wrong checksum");
  expect_error(kHugePng, "huge PNG");
  expect_error({}, "nothing");
  expect_error({'B', 'M', 0, 0}, "another format");

  Texture missing;
  missing.file = "no/such/file.png";
  const auto store = TextureStore::open({missing});
  ASSERT_FALSE(store);
  EXPECT_EQ(store.error().kind, ErrorKind::kInvalidInput);
  EXPECT_EQ(store.error().message.rfind("no/such/file.png", 0), 0u) << store.error().message;
}

TEST(TextureStore, TakesNoMemoryForWhatAHeaderPromises) {
  const auto message = [](const Bytes& bytes) {
    const auto store = TextureStore::open({texture(bytes)});
    return store ? std::string() : store.error().message;
  };
  EXPECT_NE(message(kHugePng).find("image is 100000 x 100000 pixels; at most"), std::string::npos) << message(kHugePng);
  // Within the bounds of a side, and 1.5 GiB from nine bytes.
  Bytes bomb = kHugePng;
  for (const std::size_t at : {16u, 20u}) bomb[at] = bomb[at + 1] = 0, bomb[at + 2] = 0x3E, bomb[at + 3] = 0x80;
  bomb[24] = 16;
  EXPECT_NE(message(bomb).find("image is 16000 x 16000 pixels, more than its 9 bytes of data can hold"),
            std::string::npos)
      << message(bomb);
  // What a packer can do at best is taken.
  const TextureStore store = open({texture(encode<std::uint8_t>("png", 2048, 2048, 4, Bytes(2048 * 2048 * 4, 0)))});
  expect_near(store.lookup(0, {0.5f, 0.5f}), {0, 0, 0, 0});
}

TEST(TextureStore, DamagedBytesNeverCrash) {
  const std::vector<Bytes> seeds = {kPalettePng, kOneBitPng, encode<std::uint8_t>("png", 16, 16, 4, Bytes(1024, 9)),
                                    encode<std::uint8_t>("jpeg", 32, 32, 3, Bytes(3072, 99))};
  PathRng rng(4, Stream::kTest, 0, 0);
  int opened = 0;
  for (int i = 0; i < 400; ++i) {
    Bytes bytes = seeds[static_cast<std::size_t>(i) % seeds.size()];
    for (int k = 0; k < 3; ++k) {
      bytes[static_cast<std::size_t>(rng.next1() * static_cast<float>(bytes.size()))] =
          static_cast<std::uint8_t>(256.0f * rng.next1());
    }
    const auto store = TextureStore::open({texture(bytes)});
    if (store) {
      ++opened;
      EXPECT_TRUE(std::isfinite(store->lookup(0, {0.3f, 0.3f}).x));
    }
  }
  EXPECT_LT(opened, 400);
}

TEST(TextureStore, ReadsFilesAndSharesThemBetweenTextures) {
  const TempFolder folder;
  const std::string file = (folder / "grey.png").string();
  const Bytes png = encode<std::uint8_t>("png", 1, 1, 1, {128});
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(png.data()), static_cast<std::streamsize>(png.size()));
  Texture linear, srgb;
  linear.file = srgb.file = file;
  srgb.color_space = ColorSpace::kSrgb;
  const TextureStore store = open({linear, srgb});
  std::filesystem::remove(file);
  EXPECT_NEAR(store.lookup(0, {0.5f, 0.5f}).x, 128.0f / 255.0f, 1e-6f);
  EXPECT_NEAR(store.lookup(1, {0.5f, 0.5f}).x, kSrgb128, 1e-6f);
}

TEST(TransformUv, FollowsTheExtensionsMatrices) {
  TextureRef ref;
  ref.offset = {0.25f, 0.5f};
  ref.scale = {2.0f, 3.0f};
  Vec2f uv = transform_uv(ref, {0.1f, 0.2f});
  EXPECT_NEAR(uv.x, 0.45f, 1e-6f);
  EXPECT_NEAR(uv.y, 1.1f, 1e-6f);
  ref = {};
  ref.rotation = 0.5f * kPi;  // (u, v) -> (v, -u)
  uv = transform_uv(ref, {0.1f, 0.2f});
  EXPECT_NEAR(uv.x, 0.2f, 1e-6f);
  EXPECT_NEAR(uv.y, -0.1f, 1e-6f);
  // The extension's example: the lower left quadrant of the image, turned clockwise.
  ref.offset = {0.0f, 1.0f};
  ref.scale = {0.5f, 0.5f};
  EXPECT_NEAR(transform_uv(ref, {1.0f, 1.0f}).x, 0.5f, 1e-6f);
  EXPECT_NEAR(transform_uv(ref, {1.0f, 1.0f}).y, 0.5f, 1e-6f);
  EXPECT_NEAR(transform_uv(ref, {0.0f, 0.0f}).y, 1.0f, 1e-6f);
}

}  // namespace
}  // namespace pf
