// The bytes on the wire, held fixed: another version of the code must write and read these. After a change
// that is meant, raise kWireVersion, run with PHOTONFARM_UPDATE_GOLDEN=1 set and look at the difference. The
// same messages are the fuzzer's seeds.

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

#include <gtest/gtest.h>

#include "common/base/atomic_file.h"
#include "common/wire/chunk.h"
#include "common/wire/statistics_codec.h"
#include "tests/support/paths.h"
#include "tests/unit/wire/samples.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

const fs::path kGolden = test::source_dir() / "tests/unit/wire/golden";
const fs::path kSeeds = test::source_dir() / "tests/fuzz/corpus/wire";

/// 32 bytes a line, so that a difference can be read.
std::string hex_lines(std::string_view bytes) {
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 32) text += sha256_hex_of_bytes(bytes.substr(i, 32)) + "\n";
  return text;
}

std::string from_hex_lines(std::string text) {
  std::erase(text, '\n');
  return sha256_bytes(text);
}

/// The golden bytes of this name; written anew when that is asked for. `selector`: the fuzzer's first byte.
std::string golden(const std::string& name, std::string_view bytes, char selector) {
  const fs::path file = kGolden / (name + ".hex");
  if (std::getenv("PHOTONFARM_UPDATE_GOLDEN") != nullptr) {
    EXPECT_TRUE(write_file_atomically(file, hex_lines(bytes)));
    EXPECT_TRUE(write_file_atomically(kSeeds / name, selector + std::string(bytes)));
  }
  const auto text = read_file(file, 1 << 20);
  EXPECT_TRUE(text) << "no golden bytes";
  return text ? from_hex_lines(*text) : "";
}

template <typename Message, typename Parse>
void expect_golden(const std::string& name, const Message& message, Parse parse, char selector) {
  const std::string bytes = to_bytes(message);
  const std::string expected = golden(name, bytes, selector);
  EXPECT_EQ(hex_lines(bytes), hex_lines(expected)) << name;
  const auto parsed = parse(expected);
  ASSERT_TRUE(parsed) << name << ": " << parsed.error().message;
  EXPECT_EQ(parsed->DebugString(), message.DebugString());
}

TEST(WireGolden, EveryMessageHasTheBytesOfThisVersion) {
  expect_golden("task", test::sample_task(), &parse_task, '0');
  expect_golden("prepare_task", test::sample_prepare_task(), &parse_task, '0');
  for (const std::string& body : test::from_worker_bodies()) {
    expect_golden("from_worker_" + body, test::sample_from_worker(body), &parse_from_worker, '1');
  }
  for (const std::string& body : test::to_worker_bodies()) {
    expect_golden("to_worker_" + body, test::sample_to_worker(body), &parse_to_worker, '2');
  }
  expect_golden("bundle", test::sample_bundle(), &parse_bundle, '3');
}

/// zstd may write other bytes in another version: the content is held fixed, and one chunk as it was sent
/// must stay readable.
template <typename Decode>
void expect_golden_chunk(const std::string& name, const std::string& chunk, std::string_view magic, char selector,
                         Decode decode) {
  const auto content = open_chunk(chunk, magic, 1 << 20, 1);
  ASSERT_TRUE(content) << content.error().message;
  // The fuzzer compresses what begins with '6' or '7' itself.
  const char content_selector = static_cast<char>(selector + 2);
  EXPECT_EQ(hex_lines(content->all()), hex_lines(golden(name + "_content", content->all(), content_selector))) << name;
  decode(golden(name + "_chunk", chunk, selector));
}

TEST(WireGolden, StatisticsHaveTheBytesOfThisVersion) {
  const Statistics sums = test::sample_statistics(8, 4, true);
  expect_golden_chunk("statistics", pack_statistics(sums).chunks.at(0), "PFS1", '4', [&](const std::string& chunk) {
    Statistics into(8, 4);
    StatisticsUnpacker unpacker(into);
    ASSERT_TRUE(unpacker.add(chunk));
    EXPECT_EQ(into.pixels, sums.pixels);
    EXPECT_EQ(into.features, sums.features);
    EXPECT_EQ(unpacker.content(), pack_statistics(sums).content);
  });
}

TEST(WireGolden, RadiiHaveTheBytesOfThisVersion) {
  const auto state = test::sample_state(32);
  std::string packed;
  ASSERT_TRUE(pack_state(state, [&](std::string_view chunk) -> Result<void> {
    packed = chunk;
    return {};
  }));
  expect_golden_chunk("state", packed, "PFR1", '5', [&](const std::string& chunk) {
    std::vector<ProgressivePixel> into(32);
    StateUnpacker unpacker(into);
    ASSERT_TRUE(unpacker.add(chunk));
    EXPECT_TRUE(unpacker.complete());
    for (std::size_t i = 0; i < into.size(); ++i) {
      EXPECT_EQ(into[i][kCaustic].radius2, state[i][kCaustic].radius2);
      EXPECT_EQ(into[i][kIndirect].radius2, state[i][kIndirect].radius2);
      EXPECT_EQ(into[i].covered_radius, state[i].covered_radius);
    }
  });
}

}  // namespace
}  // namespace pf
