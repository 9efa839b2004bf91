#include <limits>

#include <gtest/gtest.h>

#include "common/wire/statistics_codec.h"
#include "tests/unit/wire/samples.h"

namespace pf {
namespace {

struct Packed {
  std::vector<std::string> chunks;
  Hash128 content;
};

Packed pack(const std::vector<ProgressivePixel>& state) {
  Packed packed;
  packed.content = pack_state(state, [&](std::string_view chunk) -> Result<void> {
                     packed.chunks.emplace_back(chunk);
                     return {};
                   }).value();
  return packed;
}

bool same_radii(const std::vector<ProgressivePixel>& a, const std::vector<ProgressivePixel>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const ProgressivePixel& p, const ProgressivePixel& q) {
    return p[kCaustic].radius2 == q[kCaustic].radius2 && p[kIndirect].radius2 == q[kIndirect].radius2 &&
           p.covered_radius == q.covered_radius;
  });
}

TEST(StateCodec, BringsBackEveryRadius) {
  const auto state = test::sample_state(400'000);
  const Packed packed = pack(state);
  ASSERT_GE(packed.chunks.size(), 2u);
  std::vector<ProgressivePixel> into(state.size());
  into[5][kCaustic].count = 3;
  StateUnpacker unpacker(into);
  for (const std::string& chunk : packed.chunks) {
    EXPECT_FALSE(unpacker.complete());
    ASSERT_TRUE(unpacker.add(chunk));
  }
  EXPECT_TRUE(unpacker.complete());
  EXPECT_TRUE(same_radii(state, into));
  EXPECT_EQ(unpacker.content(), packed.content);
  EXPECT_EQ(into[5][kCaustic].count, 3.0f) << "only radii travel";
}

TEST(StateCodec, OfNoPixelsIsCompleteAtOnce) {
  std::vector<ProgressivePixel> none;
  EXPECT_TRUE(pack(none).chunks.empty());
  EXPECT_TRUE(StateUnpacker(none).complete());
}

TEST(StateCodec, RefusesRadiiThatAreNone) {
  for (const float radius :
       {-1.0f, -0.0f, std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()}) {
    auto state = test::sample_state(5000);
    state[4500][kIndirect].radius2 = radius;
    const Packed packed = pack(state);
    std::vector<ProgressivePixel> into(5000);
    StateUnpacker unpacker(into);
    const auto added = unpacker.add(packed.chunks[0]);
    ASSERT_FALSE(added) << radius;
    EXPECT_EQ(added.error().kind, ErrorKind::kInvalidInput);
    EXPECT_TRUE(same_radii(into, std::vector<ProgressivePixel>(5000))) << "tile 0 was taken over";
    EXPECT_FALSE(unpacker.complete());
  }
}

TEST(StateCodec, KeepsAnInfiniteCoveredRadius) {
  auto state = test::sample_state(10);
  state[3].covered_radius = std::numeric_limits<float>::infinity();
  const Packed packed = pack(state);
  std::vector<ProgressivePixel> into(10);
  StateUnpacker unpacker(into);
  ASSERT_TRUE(unpacker.add(packed.chunks[0]));
  EXPECT_TRUE(same_radii(into, state));
}

TEST(StateCodec, RefusesChunksOutOfOrderOfAnotherSizeOrKind) {
  const Packed packed = pack(test::sample_state(400'000));
  std::vector<ProgressivePixel> into(400'000);
  StateUnpacker unpacker(into);
  EXPECT_FALSE(unpacker.add(packed.chunks[1]));
  ASSERT_TRUE(unpacker.add(packed.chunks[0]));
  EXPECT_FALSE(unpacker.add(packed.chunks[0]));
  std::vector<ProgressivePixel> small(399'999);
  StateUnpacker other(small);
  for (const std::string& chunk : packed.chunks) {
    if (!other.add(chunk)) break;
  }
  EXPECT_FALSE(other.complete());
  EXPECT_FALSE(StateUnpacker(into).add(pack_statistics(test::sample_statistics(20, 20, true)).chunks[0]));
  Statistics sums(2000, 200);
  EXPECT_FALSE(StatisticsUnpacker(sums).add(packed.chunks[0]));
}

TEST(StateCodec, GivesUpWhenTheSinkDoes) {
  const auto packed = pack_state(test::sample_state(10), [](std::string_view) -> Result<void> {
    return fail(ErrorKind::kInternal, "the disk is full");
  });
  ASSERT_FALSE(packed);
  EXPECT_EQ(packed.error().message, "the disk is full");
}

}  // namespace
}  // namespace pf
