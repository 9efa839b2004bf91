#include "common/wire/statistics_codec.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include <gtest/gtest.h>
#include <zstd.h>

#include "common/wire/chunk.h"
#include "common/wire/columns.h"
#include "common/wire/limits.h"
#include "tests/unit/wire/samples.h"

namespace pf {
namespace {

using test::sample_statistics;

std::string compressed(std::string_view content) {
  std::string chunk(ZSTD_compressBound(content.size()), '\0');
  chunk.resize(ZSTD_compress(chunk.data(), chunk.size(), content.data(), content.size(), 1));
  return chunk;
}

std::string content_of(std::string_view chunk) {
  std::string content(ZSTD_getFrameContentSize(chunk.data(), chunk.size()), '\0');
  EXPECT_EQ(ZSTD_decompress(content.data(), content.size(), chunk.data(), chunk.size()), content.size());
  return content;
}

bool equal(const Statistics& a, const Statistics& b) {
  return a.pixels == b.pixels && a.features == b.features && a.extras == b.extras;
}

void add_all(const PackedStatistics& packed, Statistics& into) {
  StatisticsUnpacker unpacker(into);
  for (const std::string& chunk : packed.chunks) {
    const auto added = unpacker.add(chunk);
    ASSERT_TRUE(added) << added.error().message;
  }
  EXPECT_EQ(unpacker.content(), packed.content);
}

TEST(StatisticsCodec, BringsBackEverySum) {
  for (const bool features : {false, true}) {
    const Statistics sums = sample_statistics(203, 177, features);  // 8 tiles and a part of one
    const PackedStatistics packed = pack_statistics(sums);
    Statistics into(203, 177, features);
    add_all(packed, into);
    EXPECT_TRUE(equal(sums, into));
    EXPECT_EQ(packed.raw_bytes, sums.pixels.size() * (features ? 104 : 88));
    for (const std::string& chunk : packed.chunks) EXPECT_LE(chunk.size(), kMaxChunkBytes);
  }
}

TEST(StatisticsCodec, TakesTheExtremesOfEveryMember) {
  Statistics sums(64, 65);
  for (std::size_t i = 0; i < sums.pixels.size(); i += 3) {
    PixelSums& p = sums.pixels[i];
    p.direct = {std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max(), -1};
    p.photons = {std::numeric_limits<std::uint32_t>::max(), 1};
    sums.features[i].albedo = {std::numeric_limits<std::int16_t>::min(), std::numeric_limits<std::int16_t>::max(), -1};
    sums.features[i].depth_and_samples = std::numeric_limits<std::uint32_t>::max();
  }
  Statistics into(64, 65);
  add_all(pack_statistics(sums), into);
  EXPECT_TRUE(equal(sums, into));
}

TEST(StatisticsCodec, AddsResultsInAnyOrderToTheSameSums) {
  std::vector<Statistics> results;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) results.push_back(sample_statistics(100, 90, seed == 2, seed));
  Statistics expected(100, 90);
  for (const Statistics& result : results) ASSERT_TRUE(expected.add(result));
  for (const auto& order : {std::array{0, 1, 2}, std::array{2, 0, 1}}) {
    Statistics into(100, 90);
    for (const int i : order) add_all(pack_statistics(results[static_cast<std::size_t>(i)]), into);
    EXPECT_TRUE(equal(expected, into));
  }
}

TEST(StatisticsCodec, LeavesOutTilesWithoutLight) {
  EXPECT_TRUE(pack_statistics(Statistics(300, 300)).chunks.empty());
  Statistics sums(300, 300);
  sums.pixels[50'000].direct[0] = 5;
  const PackedStatistics packed = pack_statistics(sums);
  ASSERT_EQ(packed.chunks.size(), 1u);
  EXPECT_LT(content_of(packed.chunks[0]).size(), 2 * kTilePixels);
  Statistics into(300, 300, false);
  add_all(packed, into);
  EXPECT_EQ(into.pixels, sums.pixels);
  EXPECT_TRUE(into.features.empty()) << "features that are all zero do not travel";
}

TEST(StatisticsCodec, MakesRoomForFeaturesWhenTheyCome) {
  const Statistics sums = sample_statistics(80, 80, true);
  Statistics into(80, 80, false);
  add_all(pack_statistics(sums), into);
  EXPECT_TRUE(equal(sums, into));
}

TEST(StatisticsCodec, BringsExtrasBackAndTakesThemOff) {
  Statistics sums = sample_statistics(80, 80, true);
  sums.extras.resize(sums.pixels.size());
  for (std::size_t i = 0; i < sums.extras.size(); i += 7) {
    sums.extras[i] = {{-static_cast<std::int64_t>(i), std::int64_t{1} << 62, 5}, static_cast<std::int64_t>(i)};
  }
  const PackedStatistics packed = pack_statistics(sums);
  EXPECT_EQ(packed.raw_bytes, sums.pixels.size() * (88 + 16 + 32));
  Statistics into(80, 80, false);
  add_all(packed, into);
  EXPECT_TRUE(equal(sums, into));
  for (const std::string& chunk : packed.chunks) ASSERT_TRUE(StatisticsUnpacker(into).take_off(chunk));
  Statistics zero(80, 80, true, true);
  EXPECT_TRUE(equal(into, zero));
}

TEST(StatisticsCodec, TakesOffExactlyWhatWasAdded) {
  const Statistics before = sample_statistics(150, 90, true, 1);
  const PackedStatistics packed = pack_statistics(sample_statistics(150, 90, true, 2));
  Statistics into = before;
  StatisticsUnpacker unpacker(into);
  for (const std::string& chunk : packed.chunks) ASSERT_TRUE(unpacker.add(chunk));
  EXPECT_FALSE(equal(before, into));
  for (const std::string& chunk : packed.chunks) ASSERT_TRUE(unpacker.take_off(chunk));
  EXPECT_TRUE(equal(before, into));
}

TEST(StatisticsCodec, TakesNothingOffThatIsNotThere) {
  const PackedStatistics packed = pack_statistics(sample_statistics(64, 64, true));
  Statistics into(64, 64);
  const auto taken = StatisticsUnpacker(into).take_off(packed.chunks[0]);
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().kind, ErrorKind::kInternal);
  EXPECT_TRUE(equal(into, Statistics(64, 64)));
}

TEST(StatisticsCodec, RefusesAChunkThatComesTwiceOrOutOfOrder) {
  const Statistics sums = sample_statistics(300, 300, true);
  const PackedStatistics packed = pack_statistics(sums);
  ASSERT_GE(packed.chunks.size(), 3u);
  Statistics into(300, 300);
  StatisticsUnpacker unpacker(into);
  ASSERT_TRUE(unpacker.add(packed.chunks[0]));
  EXPECT_FALSE(unpacker.add(packed.chunks[0]));
  ASSERT_TRUE(unpacker.add(packed.chunks[2]));
  EXPECT_FALSE(unpacker.add(packed.chunks[1]));
  EXPECT_NE(unpacker.content(), packed.content);
}

TEST(StatisticsCodec, LeavesNothingOfAChunkThatOverflows) {
  Statistics sums = sample_statistics(64, 128, true);  // two tiles in one chunk
  const PackedStatistics packed = pack_statistics(sums);
  ASSERT_EQ(packed.chunks.size(), 1u);
  const auto refused = [&](auto&& prepare) {
    Statistics into(64, 128);
    prepare(into);
    const Statistics before = into;
    const auto added = StatisticsUnpacker(into).add(packed.chunks[0]);
    return !added && added.error().kind == ErrorKind::kInternal && equal(before, into);
  };
  EXPECT_TRUE(refused([](Statistics& s) { s.pixels[8000].direct[2] = std::numeric_limits<std::int64_t>::max() - 5; }));
  EXPECT_TRUE(refused([](Statistics& s) { s.pixels[8000].photons[1] = std::numeric_limits<std::uint32_t>::max(); }));
  EXPECT_TRUE(refused([](Statistics& s) { s.features[5].albedo.fill(std::numeric_limits<std::int16_t>::max()); }));
  EXPECT_TRUE(refused([](Statistics& s) { s.features[5].depth_and_samples = 15; }))
      << "16 samples do not fit four bits";
  EXPECT_FALSE(refused([](Statistics&) {}));
}

TEST(StatisticsCodec, RefusesAChunkOfAnotherSizeOfImage) {
  const PackedStatistics packed = pack_statistics(sample_statistics(64, 128, false));
  for (const auto& [width, height] : {std::pair{64, 64}, std::pair{64, 127}, std::pair{0, 0}}) {
    Statistics into(width, height);
    const auto added = StatisticsUnpacker(into).add(packed.chunks[0]);
    ASSERT_FALSE(added) << width << 'x' << height;
    EXPECT_EQ(added.error().kind, ErrorKind::kInvalidInput);
    EXPECT_TRUE(equal(into, Statistics(width, height)));
  }
}

TEST(StatisticsCodec, RefusesEveryTruncation) {
  const PackedStatistics packed = pack_statistics(sample_statistics(9, 7, true));
  const std::string content = content_of(packed.chunks[0]);
  for (std::size_t size = 0; size < packed.chunks[0].size(); ++size) {
    Statistics into(9, 7);
    EXPECT_FALSE(StatisticsUnpacker(into).add(packed.chunks[0].substr(0, size)));
  }
  for (std::size_t size = 0; size < content.size(); ++size) {
    Statistics into(9, 7);
    ASSERT_FALSE(StatisticsUnpacker(into).add(compressed(content.substr(0, size)))) << size;
    ASSERT_TRUE(equal(into, Statistics(9, 7)));
  }
  Statistics into(9, 7);
  EXPECT_FALSE(StatisticsUnpacker(into).add(compressed(content + '\0')));
  EXPECT_FALSE(StatisticsUnpacker(into).add(packed.chunks[0] + packed.chunks[0])) << "a second frame";
  const std::string skippable("\x50\x2a\x4d\x18\0\0\0\0", 8);
  EXPECT_FALSE(StatisticsUnpacker(into).add(packed.chunks[0] + skippable)) << "a frame that zstd passes over";
  EXPECT_TRUE(StatisticsUnpacker(into).add(compressed(content)));
}

TEST(StatisticsCodec, FlippedBitsAreRefusedOrAddWhatTheySay) {
  const PackedStatistics packed = pack_statistics(sample_statistics(9, 7, true));
  const std::string content = content_of(packed.chunks[0]);
  int refused = 0;
  for (std::size_t bit = 0; bit < 8 * content.size(); ++bit) {
    std::string broken = content;
    broken[bit / 8] = static_cast<char>(broken[bit / 8] ^ (1 << bit % 8));
    const std::string chunk = compressed(broken);
    Statistics into(9, 7);
    StatisticsUnpacker unpacker(into);
    if (!unpacker.add(chunk)) {
      ++refused;
      ASSERT_TRUE(equal(into, Statistics(9, 7))) << bit;
    } else {
      ASSERT_NE(unpacker.content(), packed.content);
      ASSERT_TRUE(unpacker.take_off(chunk));
      ASSERT_TRUE(equal(into, Statistics(9, 7))) << bit;
    }
  }
  EXPECT_GT(refused, 64) << "magic, tile count and tile index at least";
}

TEST(StatisticsCodec, RefusesContentThatIsLargerThanItsTiles) {
  Statistics into(8, 8);
  const std::string bomb = compressed("PFS1" + std::string(100'000'000, '\0'));
  ASSERT_LT(bomb.size(), 20'000u);
  const auto added = StatisticsUnpacker(into).add(bomb);
  ASSERT_FALSE(added);
  EXPECT_NE(added.error().message.find("bytes of content"), std::string::npos) << added.error().message;
}

TEST(StatisticsCodec, RefusesValuesOutsideTheirMember) {
  // One tile of one pixel: photons[0] is column 10; base 2^32-1 and a difference of 1 leave 32 bits.
  Statistics sums(1, 1);
  sums.pixels[0].photons[0] = std::numeric_limits<std::uint32_t>::max();
  std::string content = content_of(pack_statistics(sums).chunks[0]);
  const std::size_t column = kChunkHeaderBytes + 5 + 10 * kColumnHeaderBytes;
  content[column] = 1;
  content.insert(column + kColumnHeaderBytes, 1, 1);
  Statistics into(1, 1);
  const auto added = StatisticsUnpacker(into).add(compressed(content));
  ASSERT_FALSE(added);
  EXPECT_EQ(added.error().kind, ErrorKind::kInvalidInput);
  EXPECT_NE(added.error().message.find("impossible values"), std::string::npos) << added.error().message;
  EXPECT_TRUE(equal(into, Statistics(1, 1)));
}

}  // namespace
}  // namespace pf
