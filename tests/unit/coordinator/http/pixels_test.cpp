// What the dashboard is made of and draws: its files, and layers as half floats.

#include <array>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include <Imath/half.h>

#include "coordinator/http/pixel_cache.h"
#include "tests/unit/coordinator/http/fixture.h"

namespace pf::test {
namespace {

using nlohmann::json;

/// 6x3 pixels: beauty holds x, y and a number beyond any half; depth 10 x + y.
LayeredImage small_image() {
  LayeredImage image;
  image.width = 6;
  image.height = 3;
  Layer beauty{"", {"R", "G", "B"}, {}}, depth{"depth", {"Z"}, {}}, radius{"radius", {"caustic", "indirect"}, {}};
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      for (const float v : {static_cast<float>(x), static_cast<float>(y), 1e9F}) beauty.data.push_back(v);
      depth.data.push_back(static_cast<float>(10 * x + y));
      for (const float v : {1.0F, 2.0F}) radius.data.push_back(v);
    }
  }
  image.layers = {beauty, depth, radius};
  return image;
}

/// The reply's floats.
std::vector<float> floats(const std::string& bytes) {
  std::vector<std::uint16_t> bits(bytes.size() / 2);
  std::memcpy(bits.data(), bytes.data(), bytes.size());
  std::vector<float> values;
  for (const std::uint16_t b : bits) values.push_back(half(half::FromBits, b));
  return values;
}

class PixelRoutes : public HttpTest {
 protected:
  void SetUp() override {
    HttpTest::SetUp();
    service_.put(FakeJobService::running("glass-1"));
    service_.image = small_image();
  }
  [[nodiscard]] RawReply pixels(const std::string& query, const HeaderList& headers = {}) const {
    return get("/v1/jobs/glass-1/pixels" + query, headers);
  }
  void set_passes(std::uint64_t passes, JobState state = JobState::kRunning) {
    JobView job = FakeJobService::running("glass-1");
    job.passes_done = passes;
    job.state = state;
    service_.put(job);
  }
};

TEST_F(PixelRoutes, TheBeautyComesAsHalfFloatsRowByRow) {
  const RawReply reply = pixels("");
  ASSERT_EQ(reply.status, 200);
  EXPECT_EQ(reply.headers.at("content-type"), "application/octet-stream");
  EXPECT_EQ(reply.headers.at("photonfarm-width"), "6");
  EXPECT_EQ(reply.headers.at("photonfarm-height"), "3");
  EXPECT_EQ(reply.headers.at("photonfarm-passes"), "16");
  const auto values = floats(reply.body);
  ASSERT_EQ(values.size(), 3U * 6 * 3);
  EXPECT_EQ(values[3 * 5], 5.0F);
  EXPECT_EQ(values[3 * (6 + 2) + 1], 1.0F);
  EXPECT_EQ(values[2], 65504.0F) << "the largest half, not infinity";
}

TEST_F(PixelRoutes, ASmallerImageIsTheMeanOfBlocks) {
  const RawReply reply = pixels("?layer=depth&max_width=3");
  ASSERT_EQ(reply.status, 200);
  EXPECT_EQ(reply.headers.at("photonfarm-width"), "3");
  EXPECT_EQ(reply.headers.at("photonfarm-height"), "2");
  const auto values = floats(reply.body);
  ASSERT_EQ(values.size(), 3U * 3 * 2);
  EXPECT_EQ(values[0], 5.5F);  // 0, 10, 1, 11
  EXPECT_EQ(values[1], 5.5F) << "one channel fills all three";
  EXPECT_EQ(values[3 * (3 + 1)], 27.0F);  // the last row alone: 22, 32
}

TEST_F(PixelRoutes, LayersAreListedAsInTheExr) {
  const json layers = json::parse(get("/v1/jobs/glass-1/layers").body);
  EXPECT_EQ(layers["layers"], json({"beauty", "depth", "radius"}));
  EXPECT_EQ(layers["channels"]["radius"], json({"caustic", "indirect"}));
  EXPECT_EQ(layers["width"], 6);
  EXPECT_EQ(layers["height"], 3);
}

TEST_F(PixelRoutes, NothingNewIsNotSentAgain) {
  const std::string etag = pixels("").headers.at("etag");
  const RawReply same = pixels("", {{"If-None-Match", etag}});
  EXPECT_EQ(same.status, 304);
  EXPECT_EQ(same.headers.at("photonfarm-passes"), "16");
  EXPECT_TRUE(same.body.empty());
  set_passes(17, JobState::kDone);
  EXPECT_EQ(pixels("", {{"If-None-Match", etag}}).status, 200);
  EXPECT_EQ(service_.pixels_made, 2);
}

TEST_F(PixelRoutes, ManyWatchersCostOneImage) {
  for (int i = 0; i < 20; ++i) EXPECT_EQ(pixels("").status, 200);
  EXPECT_EQ(service_.pixels_made, 1);
}

TEST_F(PixelRoutes, AnEndedJobsLayersAreReadFromItsExr) {
  const LayeredImage image = small_image();
  const auto exr = temp_ / "glass.exr";
  ASSERT_TRUE(write_exr(exr, image));
  service_.artifacts[Artifact::kExr] = exr;
  service_.image.reset();
  set_passes(64, JobState::kDone);
  EXPECT_EQ(json::parse(get("/v1/jobs/glass-1/layers").body)["layers"], json({"beauty", "depth", "radius"}));
  const RawReply reply = pixels("?layer=radius");
  ASSERT_EQ(reply.status, 200);
  EXPECT_EQ(reply.headers.at("photonfarm-passes"), "64");
  const auto values = floats(reply.body);
  EXPECT_EQ(values[0], 1.0F);
  EXPECT_EQ(values[1], 2.0F);
  EXPECT_EQ(values[2], 0.0F);
}

TEST_F(PixelRoutes, WhatCannotBeShownIsRefusedWithTheReason) {
  EXPECT_EQ(get("/v1/jobs/nobody/pixels").status, 404);
  const RawReply layer = pixels("?layer=dept");
  EXPECT_EQ(layer.status, 400);
  EXPECT_NE(problem(layer).find("did you mean depth?"), std::string::npos);
  for (const char* width : {"0", "-1", "2049", "wide", "1e3"})
    EXPECT_EQ(pixels(std::string("?max_width=") + width).status, 400) << width;
  service_.image.reset();
  EXPECT_EQ(pixels("?layer=beauty&max_width=5").status, 409);
  EXPECT_EQ(get("/v1/jobs/glass-1/layers").status, 409);
}

TEST(PixelCache, ALaggingImageIsServedOnlyToThoseWhoMayLag) {
  PixelCache cache(1 << 20);
  int made = 0;
  const auto make = [&]() -> Result<LayerPixels> {
    ++made;
    // What takes long to make is kept long: the pause is a multiple of it.
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(50);
    while (std::chrono::steady_clock::now() < end) {
    }
    return LayerPixels{1, 1, static_cast<std::uint64_t>(made), {0, 0, 0}};
  };
  EXPECT_EQ((*cache.get("a", "1", true, make))->passes, 1U);
  EXPECT_EQ((*cache.get("a", "2", true, make))->passes, 1U);
  EXPECT_EQ((*cache.get("a", "2", false, make))->passes, 2U);
  EXPECT_EQ((*cache.get("b", "2", true, make))->passes, 3U);
}

TEST(PixelCache, HoldsNoMoreThanItsBytes) {
  PixelCache cache(25);
  int made = 0;
  const auto make = [&]() -> Result<LayerPixels> {
    return LayerPixels{2, 1, static_cast<std::uint64_t>(++made), {0, 0, 0, 0, 0, 0}};
  };
  for (const char* key : {"a", "b", "c"}) ASSERT_TRUE(cache.get(key, "1", false, make));
  EXPECT_EQ((*cache.get("c", "1", false, make))->passes, 3U);
  EXPECT_EQ((*cache.get("a", "1", false, make))->passes, 4U) << "the oldest had to go";
}

class WebRoutes : public HttpTest {
 protected:
  void SetUp() override {
    static constexpr std::array<WebFile, 2> kFiles = {
        {{"/", "text/html; charset=utf-8", "\"1\"", false, "<p>page"},
         {"/assets/app-AB.js", "text/javascript", "\"2\"", true, "run()"}}};
    options_.web = kFiles;
    HttpTest::SetUp();
  }
};

TEST_F(WebRoutes, ThePageNeedsNoTokenAndTrustsNothingElse) {
  const RawReply reply = call("GET", "/", {}, {}, false);
  EXPECT_EQ(reply.status, 200);
  EXPECT_EQ(reply.body, "<p>page");
  const std::string policy = reply.headers.at("content-security-policy");
  for (const char* part : {"default-src 'none'", "script-src 'self'", "style-src 'self'", "frame-ancestors 'none'"})
    EXPECT_NE(policy.find(part), std::string::npos) << part;
  EXPECT_EQ(policy.find("unsafe"), std::string::npos);
  EXPECT_EQ(reply.headers.at("referrer-policy"), "no-referrer");
  EXPECT_EQ(reply.headers.at("x-content-type-options"), "nosniff");
  EXPECT_EQ(call("GET", "/v1/jobs", {}, {}, false).status, 401);
}

TEST_F(WebRoutes, OnlyHashedNamesAreKeptForGood) {
  const RawReply page = get("/"), script = get("/assets/app-AB.js");
  EXPECT_EQ(page.headers.at("cache-control"), "no-cache");
  EXPECT_NE(script.headers.at("cache-control").find("immutable"), std::string::npos);
  EXPECT_EQ(get("/", {{"If-None-Match", page.headers.at("etag")}}).status, 304);
}

TEST_F(WebRoutes, OtherFilesAndMethodsAreRefused) {
  EXPECT_EQ(get("/assets/../token").status, 404);
  EXPECT_EQ(get("/assets/none.js").status, 404);
  EXPECT_EQ(call("POST", "/").status, 405);
  EXPECT_EQ(call("HEAD", "/", {}, {}, false).status, 200);
}

}  // namespace
}  // namespace pf::test
