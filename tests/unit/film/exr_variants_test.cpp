// Files that other programs write, made here with OpenEXR itself.

#include <cmath>

#include <OpenEXR/ImfArray.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDeepFrameBuffer.h>
#include <OpenEXR/ImfDeepScanLineOutputFile.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfTiledOutputFile.h>
#include <gtest/gtest.h>

#include "common/film/image.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;
using Imath::Box2i;

class ExrVariant : public testing::Test {
 protected:
  TempFolder folder_;
  fs::path file_ = folder_ / "variant.exr";
};

/// The value of a channel at a pixel of the file; small integers are exact in half, uint and float alike.
float value_at(int x, int y, std::size_t channel) {
  return static_cast<float>(((x + 50) * 3 + (y + 50) * 5 + static_cast<int>(channel) * 7) % 251);
}

/// Planes of value_at over a data window, and the frame buffer that points to them.
struct Source {
  std::vector<std::vector<float>> planes;
  Imf::FrameBuffer frame;

  Source(const Imf::ChannelList& channels, const Box2i& window) {
    std::size_t index = 0;
    for (auto it = channels.begin(); it != channels.end(); ++it, ++index) {
      std::vector<float>& plane = planes.emplace_back();
      for (int y = window.min.y; y <= window.max.y; ++y) {
        for (int x = window.min.x; x <= window.max.x; ++x) plane.push_back(value_at(x, y, index));
      }
    }
    index = 0;
    for (auto it = channels.begin(); it != channels.end(); ++it, ++index) {
      frame.insert(it.name(), Imf::Slice::Make(Imf::FLOAT, planes[index].data(), window));
    }
  }
};

Imf::Header make_header(const Box2i& display, const Box2i& data, Imf::Compression compression = Imf::ZIP_COMPRESSION) {
  Imf::Header header(display, data);
  header.compression() = compression;
  for (const char* name : {"B", "G", "R"}) header.channels().insert(name, Imf::Channel(Imf::FLOAT));
  return header;
}

/// OpenEXR writes the type that the frame buffer has, so the planes are float in every test but that of
/// types.
void write_scan_lines(const fs::path& file, const Imf::Header& header) {
  const Source source(header.channels(), header.dataWindow());
  Imf::OutputFile output(file.c_str(), header, 0);
  output.setFrameBuffer(source.frame);
  output.writePixels(header.dataWindow().max.y - header.dataWindow().min.y + 1);
}

/// R, G, B as value_at says inside the data window (channels are stored by name: B 0, G 1, R 2), 0 elsewhere.
void expect_windowed(const Result<LayeredImage>& image, const Box2i& display, const Box2i& data) {
  ASSERT_TRUE(image) << image.error().message;
  ASSERT_EQ(image->width, display.max.x - display.min.x + 1);
  ASSERT_EQ(image->height, display.max.y - display.min.y + 1);
  ASSERT_EQ(image->layers.size(), 1u);
  ASSERT_EQ(image->layers[0].channels, (std::vector<std::string>{"R", "G", "B"}));
  std::size_t wrong = 0;
  std::size_t i = 0;
  for (int y = display.min.y; y <= display.max.y; ++y) {
    for (int x = display.min.x; x <= display.max.x; ++x) {
      const bool inside = x >= data.min.x && x <= data.max.x && y >= data.min.y && y <= data.max.y;
      for (std::size_t channel : {2u, 1u, 0u}) {
        wrong += image->layers[0].data[i++] == (inside ? value_at(x, y, channel) : 0.0f) ? 0 : 1;
      }
    }
  }
  EXPECT_EQ(wrong, 0u);
}

TEST_F(ExrVariant, DataWindowMayLieAnywhereAgainstTheDisplayWindow) {
  const Box2i display({-3, 2}, {8, 12});
  for (const Box2i& data : {Box2i({-3, 2}, {8, 12}), Box2i({0, 4}, {3, 6}), Box2i({-20, -20}, {40, 40}),
                            Box2i({-9, 5}, {2, 30}), Box2i({5, -7}, {30, 3}), Box2i({20, 20}, {22, 22})}) {
    write_scan_lines(file_, make_header(display, data));
    expect_windowed(read_exr(file_), display, data);
  }
}

TEST_F(ExrVariant, EveryLosslessCompressionAndLineOrderReadsTheSame) {
  const Box2i window({0, 0}, {40, 600});
  for (const Imf::Compression compression :
       {Imf::NO_COMPRESSION, Imf::RLE_COMPRESSION, Imf::ZIPS_COMPRESSION, Imf::ZIP_COMPRESSION, Imf::PIZ_COMPRESSION}) {
    for (const Imf::LineOrder order : {Imf::INCREASING_Y, Imf::DECREASING_Y}) {
      Imf::Header header = make_header(window, window, compression);
      header.lineOrder() = order;
      write_scan_lines(file_, header);
      expect_windowed(read_exr(file_), window, window);
    }
  }
}

TEST_F(ExrVariant, LossyCompressionsReadTheirWholeHeight) {
  const Box2i window({0, 0}, {63, 599});
  for (const Imf::Compression compression : {Imf::PXR24_COMPRESSION, Imf::B44_COMPRESSION, Imf::B44A_COMPRESSION,
                                             Imf::DWAA_COMPRESSION, Imf::DWAB_COMPRESSION}) {
    write_scan_lines(file_, make_header(window, window, compression));
    const auto image = read_exr(file_);
    ASSERT_TRUE(image) << image.error().message;
    const float last = image->layers[0].data.back();
    EXPECT_NEAR(last, value_at(63, 599, 0), 40.0f) << compression;
  }
}

TEST_F(ExrVariant, TilesAndMipmapsReadTheirFinestLevel) {
  const Box2i display({-3, 2}, {90, 80});
  for (const Imf::LevelMode mode : {Imf::ONE_LEVEL, Imf::MIPMAP_LEVELS}) {
    for (const Box2i& data : {display, Box2i({-20, -20}, {40, 140})}) {
      Imf::Header header = make_header(display, data);
      header.setTileDescription(Imf::TileDescription(32, 16, mode));
      const Source source(header.channels(), data);
      {
        Imf::TiledOutputFile output(file_.c_str(), header, 0);
        output.setFrameBuffer(source.frame);
        for (int level = 0; level < output.numLevels(); ++level) {
          output.writeTiles(0, output.numXTiles(level) - 1, 0, output.numYTiles(level) - 1, level);
        }
      }
      expect_windowed(read_exr(file_), display, data);
    }
  }
}

TEST_F(ExrVariant, OfSeveralPartsTheFirstIsRead) {
  const Box2i window({0, 0}, {9, 5});
  Imf::Header headers[2] = {make_header(window, window), make_header({{0, 0}, {3, 3}}, {{0, 0}, {3, 3}})};
  headers[0].setName("first");
  headers[1].setName("second");
  for (Imf::Header& header : headers) header.setType(Imf::SCANLINEIMAGE);
  {
    Imf::MultiPartOutputFile output(file_.c_str(), headers, 2, true, 0);
    for (int i = 0; i < 2; ++i) {
      const Source source(headers[i].channels(), headers[i].dataWindow());
      Imf::OutputPart part(output, i);
      part.setFrameBuffer(source.frame);
      part.writePixels(headers[i].dataWindow().max.y + 1);
    }
  }
  expect_windowed(read_exr(file_), window, window);
}

TEST_F(ExrVariant, HalvesAndIntegersBecomeFloats) {
  const int width = 3, height = 2;
  Imf::Header header(width, height);
  header.channels().insert("half.V", Imf::Channel(Imf::HALF));
  header.channels().insert("id.U", Imf::Channel(Imf::UINT));
  const std::vector<half> halves = {half(0.5f), half(-2.0f), half(65504.0f), half(1.0f), half(0.0f), half(3.0f)};
  const std::vector<unsigned> integers = {0, 1, 2, 70000, 16777216, 4294967295u};
  {
    Imf::FrameBuffer frame;
    frame.insert("half.V", Imf::Slice::Make(Imf::HALF, halves.data(), {0, 0}, width, height));
    frame.insert("id.U", Imf::Slice::Make(Imf::UINT, integers.data(), {0, 0}, width, height));
    Imf::OutputFile output(file_.c_str(), header, 0);
    output.setFrameBuffer(frame);
    output.writePixels(height);
  }
  const auto image = read_exr(file_);
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(image->find("half")->data, (std::vector<float>{0.5f, -2.0f, 65504.0f, 1.0f, 0.0f, 3.0f}));
  EXPECT_EQ(image->find("id")->data, (std::vector<float>{0, 1, 2, 70000, 16777216, 4294967296.0f}));
}

TEST_F(ExrVariant, LuminanceAndChromaBecomeColours) {
  const Box2i display({-2, 0}, {29, 19});
  const Box2i data({-4, 2}, {25, 25});
  const int width = 30, height = 24;
  std::vector<Imf::Rgba> pixels(width * height, Imf::Rgba(0.25f, 0.5f, 0.75f, 0.5f));
  for (const Imf::RgbaChannels channels : {Imf::WRITE_YC, Imf::WRITE_YCA}) {
    {
      Imf::Header header(display, data);
      Imf::RgbaOutputFile output(file_.c_str(), header, channels, 0);
      output.setFrameBuffer(Imf::ComputeBasePointer(pixels.data(), data), 1, width);
      output.writePixels(height);
    }
    const auto image = read_exr(file_);
    ASSERT_TRUE(image) << image.error().message;
    EXPECT_EQ(image->width, 32);
    EXPECT_EQ(image->height, 20);
    const Layer& layer = image->layers[0];
    const std::size_t count = channels == Imf::WRITE_YCA ? 4 : 3;
    ASSERT_EQ(layer.channels.size(), count);
    const std::size_t inside = (std::size_t{10} * 32 + 10) * count;
    EXPECT_NEAR(layer.data[inside], 0.25f, 2e-3f);
    EXPECT_NEAR(layer.data[inside + 1], 0.5f, 2e-3f);
    EXPECT_NEAR(layer.data[inside + 2], 0.75f, 2e-3f);
    if (count == 4) {
      EXPECT_EQ(layer.data[inside + 3], 0.5f);
    }
    EXPECT_EQ(layer.data[0], 0.0f);
  }
}

TEST_F(ExrVariant, SubsampledChannelsOfOtherNamesAreRefused) {
  Imf::Header header(8, 8);
  header.channels().insert("G", Imf::Channel(Imf::FLOAT));
  header.channels().insert("R", Imf::Channel(Imf::FLOAT, 2, 2));
  const std::vector<float> zeros(64, 0.0f);
  {
    Imf::FrameBuffer frame;
    frame.insert("G", Imf::Slice::Make(Imf::FLOAT, zeros.data(), {0, 0}, 8, 8));
    frame.insert("R", Imf::Slice::Make(Imf::FLOAT, zeros.data(), {0, 0}, 8, 8, 4, 16, 2, 2));
    Imf::OutputFile output(file_.c_str(), header, 0);
    output.setFrameBuffer(frame);
    output.writePixels(8);
  }
  const auto image = read_exr(file_);
  ASSERT_FALSE(image);
  EXPECT_NE(image.error().message.find("subsampled"), std::string::npos) << image.error().message;
}

TEST_F(ExrVariant, DeepImagesAreRefusedByName) {
  Imf::Header header(2, 1);
  header.setType(Imf::DEEPSCANLINE);
  header.compression() = Imf::ZIPS_COMPRESSION;
  header.channels().insert("Z", Imf::Channel(Imf::FLOAT));
  unsigned counts[2] = {1, 1};
  float depths[2] = {1.0f, 2.0f};
  float* pointers[2] = {&depths[0], &depths[1]};
  {
    Imf::DeepFrameBuffer frame;
    frame.insertSampleCountSlice(Imf::Slice(Imf::UINT, reinterpret_cast<char*>(counts), sizeof(unsigned), 0));
    frame.insert("Z", Imf::DeepSlice(Imf::FLOAT, reinterpret_cast<char*>(pointers), sizeof(float*), 0, sizeof(float)));
    Imf::DeepScanLineOutputFile output(file_.c_str(), header, 0);
    output.setFrameBuffer(frame);
    output.writePixels(1);
  }
  const auto image = read_exr(file_);
  ASSERT_FALSE(image);
  EXPECT_NE(image.error().message.find("deepscanline"), std::string::npos) << image.error().message;
}

TEST_F(ExrVariant, SizesBeyondTheLimitAreRefusedBeforeMemoryIsTaken) {
  const Box2i small({0, 0}, {3, 3});
  write_scan_lines(file_, make_header({{0, 0}, {kMaxImageEdge, 3}}, small));
  EXPECT_NE(read_exr(file_).error().message.find("display window"), std::string::npos);
  write_scan_lines(file_, make_header({{0, 0}, {kMaxImageEdge - 1, kMaxImageEdge - 1}}, small));
  EXPECT_FALSE(read_exr(file_));
}

}  // namespace
}  // namespace pf
