#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <vector>

#include "common/math/owen_sobol.h"
#include "common/math/philox.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

// Known-answer vectors of Random123 1.14 (kat_vectors, "philox4x32 10").
TEST(Philox, GivesThePublishedAnswers) {
  using Block = std::array<std::uint32_t, 4>;
  EXPECT_EQ(philox4x32({0, 0, 0, 0}, {0, 0}), (Block{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
  EXPECT_EQ(philox4x32({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}),
            (Block{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}));
  EXPECT_EQ(philox4x32({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}),
            (Block{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}));
}

TEST(PathRng, IsPhiloxBlockAfterBlock) {
  constexpr std::uint64_t kSeed = 0x123456789abcdef0, kPass = 0x1234567890;
  PathRng rng(kSeed, Stream::kPhoton, kPass, 77);
  for (std::uint32_t block = 0; block < 9; ++block) {
    const auto bits = philox4x32({77, static_cast<std::uint32_t>(kPass), 0x12 ^ (1u << 16), block},
                                 {static_cast<std::uint32_t>(kSeed), static_cast<std::uint32_t>(kSeed >> 32)});
    for (const std::uint32_t b : bits) EXPECT_EQ(rng.next1(), to_unit_float(b)) << block;
  }
}

TEST(PathRng, DependsOnEveryPartOfItsName) {
  const auto first = [](std::uint64_t seed, Stream s, std::uint64_t pass, std::uint32_t path) {
    return PathRng(seed, s, pass, path).next1();
  };
  std::set<float> values{first(1, Stream::kPhoton, 0, 0),
                         first(2, Stream::kPhoton, 0, 0),
                         first(1, Stream::kEye, 0, 0),
                         first(1, Stream::kPhoton, 1, 0),
                         first(1, Stream::kPhoton, 0, 1),
                         first(1, Stream::kPhoton, 1ull << 33, 0),
                         first(1ull << 40, Stream::kPhoton, 0, 0)};
  EXPECT_EQ(values.size(), 7u);
}

std::uint32_t sobol1_by_direction_numbers(std::uint32_t index) {
  std::uint32_t result = 0;
  for (std::uint32_t v = 1u << 31; index != 0; index >>= 1, v ^= v >> 1) {
    if (index & 1u) result ^= v;
  }
  return result;
}

TEST(Sobol, SecondDimensionEqualsTheDirectionNumbers) {
  for (std::uint32_t i = 0; i < 5000; ++i) ASSERT_EQ(sobol1(i), sobol1_by_direction_numbers(i)) << i;
  EXPECT_EQ(sobol1(0xDEADBEEF), sobol1_by_direction_numbers(0xDEADBEEF));
}

TEST(PixelSequence, FillsEveryElementaryIntervalOnceInEveryPairOfDimensions) {
  constexpr unsigned kCount = 256;
  for (int pair = 0; pair < 6; ++pair) {
    std::vector<Vec2f> points;
    for (unsigned s = 0; s < kCount; ++s) {
      PixelSequence sequence(1234, s);
      for (int skip = 0; skip < pair; ++skip) static_cast<void>(sequence.next2());
      points.push_back(sequence.next2());
    }
    for (unsigned columns = 1; columns <= kCount; columns *= 2) {
      const unsigned rows = kCount / columns;
      std::set<unsigned> cells;
      for (const Vec2f& p : points) {
        cells.insert(static_cast<unsigned>(p.x * static_cast<float>(columns)) * rows +
                     static_cast<unsigned>(p.y * static_cast<float>(rows)));
      }
      EXPECT_EQ(cells.size(), kCount) << columns << " columns, pair " << pair;
    }
  }
}

TEST(PixelSequence, OneDimensionalNumbersAreStratified) {
  std::set<unsigned> cells;
  for (unsigned s = 0; s < 64; ++s) {
    PixelSequence sequence(99, s);
    static_cast<void>(sequence.next2());
    cells.insert(static_cast<unsigned>(sequence.next1() * 64.0f));
  }
  EXPECT_EQ(cells.size(), 64u);
}

TEST(Sampling, DiskAndTrianglesAreUniform) {
  PathRng rng(7, Stream::kTest, 0, 0);
  constexpr int kCount = 200000;
  int inner = 0;
  int corner = 0;
  for (int i = 0; i < kCount; ++i) {
    const Vec2f d = sample_disk(rng.next2());
    inner += d.x * d.x + d.y * d.y < 0.25f;
    const Vec2f b = sample_triangle(rng.next2());
    ASSERT_LE(b.x + b.y, 1.0f);
    corner += b.x + b.y < 0.5f;
  }
  const double sigma = std::sqrt(0.25 * 0.75 / kCount);
  EXPECT_NEAR(inner / double{kCount}, 0.25, 4 * sigma);
  EXPECT_NEAR(corner / double{kCount}, 0.25, 4 * sigma);
}

}  // namespace
}  // namespace pf
