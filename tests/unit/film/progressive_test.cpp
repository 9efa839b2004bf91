#include "common/film/progressive.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "common/film/film.h"
#include "common/math/philox.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

constexpr double kAlpha = 2.0 / 3.0;

TEST(ProgressiveUpdate, IsHachisukasForOneSubPass) {
  // [Hachisuka08 (5), (7), (9)] by hand: N = 30, M = 12, alpha = 2/3.
  const FlowState before{0.25f, 30.0f, {3.0f, 2.0f, 1.0f}};
  const FlowState after = updated(before, 12, {6, 4, 2}, 1, kAlpha);
  EXPECT_FLOAT_EQ(after.count, 38.0f);
  EXPECT_FLOAT_EQ(after.radius2, 0.25f * 38.0f / 42.0f);
  EXPECT_FLOAT_EQ(after.tau[0], 9.0f * 38.0f / 42.0f);
  EXPECT_FLOAT_EQ(after.tau[2], 3.0f * 38.0f / 42.0f);
}

TEST(ProgressiveUpdate, ChangesNothingWithoutPhotons) {
  const FlowState before{0.25f, 30.0f, {3.0f, 2.0f, 1.0f}};
  const FlowState after = updated(before, 0, {0, 0, 0}, 1000, kAlpha);
  EXPECT_EQ(after.radius2, before.radius2);
  EXPECT_EQ(after.count, before.count);
}

TEST(ProgressiveUpdate, KeepsFluxThatCameWithoutCountedPhotons) {
  const FlowState after = updated({0.25f, 30.0f, {3.0f, 2.0f, 1.0f}}, 0, {5, 5, 5}, 7, kAlpha);
  EXPECT_EQ(after.radius2, 0.25f);
  EXPECT_EQ(after.tau[0], 8.0f);
}

TEST(ProgressiveUpdate, KeepsTheRadiusAtAlphaOne) {
  const FlowState after = updated({0.25f, 0.0f, {}}, 100, {50, 50, 50}, 10, 1.0);
  EXPECT_FLOAT_EQ(after.radius2, 0.25f);
  EXPECT_FLOAT_EQ(after.count, 100.0f);
  EXPECT_FLOAT_EQ(after.tau[0], 50.0f);
}

TEST(ProgressiveUpdate, GivesTheSameRadiusInOneRoundAsInManyWhenDensityIsUniform) {
  // 64 sub-passes, each finding 100 photons in the first disc and fewer as it shrinks.
  const double first = 0.04;
  FlowState ones{static_cast<float>(first), 0.0f, {}};
  for (int i = 0; i < 64; ++i) {
    const auto found = static_cast<std::uint32_t>(std::lround(100.0 * ones.radius2 / first));
    ones = updated(ones, found, {found, found, found}, 1, kAlpha);
  }
  FlowState grown{static_cast<float>(first), 0.0f, {}};
  for (std::uint64_t done = 0; done < 64;) {
    const std::uint64_t size = std::min<std::uint64_t>(round_size(done, 0.25), 64 - done);
    const auto found =
        static_cast<std::uint32_t>(std::lround(100.0 * static_cast<double>(size) * grown.radius2 / first));
    grown = updated(grown, found, {found, found, found}, size, kAlpha);
    done += size;
  }
  EXPECT_NEAR(grown.radius2 / ones.radius2, 1.0, 0.01);
  EXPECT_NEAR(grown.tau[0] / grown.radius2 / (ones.tau[0] / ones.radius2), 1.0, 0.01);
}

TEST(Rounds, GrowWithTheWorkDone) {
  EXPECT_EQ(round_size(0, 0.25), 2u);
  EXPECT_EQ(round_size(4, 0.25), 2u);
  EXPECT_EQ(round_size(8, 0.25), 2u);
  EXPECT_EQ(round_size(12, 0.25), 4u);
  EXPECT_EQ(round_size(400, 0.25), 96u);
  EXPECT_EQ(round_size(1, 1.0), 2u);
  EXPECT_EQ(round_size(400, 0.0), 1u);
  int barriers = 0;
  for (std::uint64_t n = 0; n < 4096; n += round_size(n, 0.25)) ++barriers;
  EXPECT_LE(barriers, 35);
}

TEST(Rounds, AreSharedOutEvenlyByWorkersInPowersOfTwo) {
  for (std::uint64_t n = 0; n < 4096; ++n) {
    const auto asked = static_cast<std::uint64_t>(1 + n / 4), size = round_size(n, 0.25);
    EXPECT_GE(3 * size, 2 * asked) << n << ": a round is no shorter than two thirds";
    EXPECT_LE(size, std::max<std::uint64_t>(2, asked)) << n;
    for (std::uint64_t workers = 2; workers <= std::max<std::uint64_t>(2, size / 2); workers *= 2)
      ASSERT_EQ(size % workers, 0u) << n << ", " << workers << " workers";
  }
}

TEST(IndependentRadius, FollowsTheRecurrenceOfKnausAndZwicker) {
  double ratio = 1.0;
  for (std::uint64_t i = 1; i < 2000; ++i) {
    ratio *= (static_cast<double>(i) - 1.0 + kAlpha) / static_cast<double>(i);
    ASSERT_NEAR(independent_radius2_ratio(i, kAlpha) / ratio, 1.0, 1e-9) << i;
  }
}

TEST(QuantisedSums, RefuseWhatDoesNotFit) {
  std::int64_t sum = 0;
  EXPECT_TRUE(add_quantised(sum, 1.0, 0x1p-24));
  EXPECT_EQ(sum, 1 << 24);
  EXPECT_FALSE(add_quantised(sum, std::nan(""), 1.0));
  EXPECT_FALSE(add_quantised(sum, 1e30, 1.0));
  sum = std::numeric_limits<std::int64_t>::max();
  EXPECT_FALSE(add_quantised(sum, 1.0, 1.0));
  EXPECT_EQ(sum, std::numeric_limits<std::int64_t>::max());
}

Statistics random_result(int seed) {
  Statistics s(3, 2);
  PathRng rng(static_cast<std::uint64_t>(seed), Stream::kTest, 0, 0);
  const auto number = [&] { return static_cast<std::int64_t>(rng.next1() * 1e9f); };
  for (PixelSums& p : s.pixels) {
    p.direct = {number(), number(), number()};
    p.flow[kCaustic] = {number(), number(), number()};
    p.photons[kIndirect] = static_cast<std::uint32_t>(number());
    p.square = number();
  }
  for (FeatureSums& f : s.features) {
    f.albedo = {static_cast<std::int16_t>(rng.next1() * 2048.0f), 1024, 1};
    f.normal = {-2048, 0, 7};
    f.add_depth(static_cast<double>(number()));
  }
  s.sub_passes = 1;
  return s;
}

TEST(Statistics, AddUpWithoutOrderOrGrouping) {
  Statistics forwards(3, 2);
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(forwards.add(random_result(i)));
  Statistics pair(3, 2);
  ASSERT_TRUE(pair.add(random_result(3)));
  ASSERT_TRUE(pair.add(random_result(1)));
  Statistics grouped(3, 2);
  ASSERT_TRUE(grouped.add(random_result(2)));
  ASSERT_TRUE(grouped.add(pair));
  ASSERT_TRUE(grouped.add(random_result(0)));
  EXPECT_EQ(forwards.pixels[4].direct, grouped.pixels[4].direct);
  EXPECT_EQ(forwards.pixels[5].flow, grouped.pixels[5].flow);
  EXPECT_EQ(forwards.features, grouped.features);
  EXPECT_EQ(forwards.sub_passes, grouped.sub_passes);
}

TEST(Statistics, ReportOverflowAndOtherSizes) {
  Statistics a(1, 1);
  Statistics b(1, 1);
  a.pixels[0].direct[0] = b.pixels[0].direct[0] = std::numeric_limits<std::int64_t>::max() / 2 + 1;
  EXPECT_FALSE(a.add(b));
  EXPECT_FALSE(a.add(Statistics(2, 1)));
}

TEST(Statistics, FeaturesHoldFifteenSamplesOfTheLargestSizeAndRefuseMore) {
  Statistics sum(1, 1, false);
  Statistics sample(1, 1);
  sample.features[0].albedo = {2048, 2048, 2048};
  sample.features[0].normal = {-2048, 2048, -2048};
  sample.features[0].add_depth(1e30);
  for (std::uint64_t i = 0; i < kFeatureSubPasses; ++i) ASSERT_TRUE(sum.add(sample)) << i;
  EXPECT_EQ(sum.features[0].samples(), kFeatureSubPasses);
  EXPECT_EQ(sum.features[0].depth(), kFeatureSubPasses * 0x1000000u);
  EXPECT_EQ(sum.features[0].normal[0], -15 * 2048);
  EXPECT_FALSE(sum.add(sample));
}

class Checkpoint : public testing::Test {
 protected:
  TempFolder folder_;
  std::filesystem::path file_ = folder_ / "film.checkpoint";

  static Film some_film() {
    FilmOptions options{3, 2, Estimator::kShared, SumScale::from_scene(2.0, 1e-5, 3.0), kAlpha, 0.25};
    Film film(options);
    std::vector<ProgressivePixel> radii(6);
    for (ProgressivePixel& p : radii) p[kCaustic].radius2 = p[kIndirect].radius2 = 0.5f;
    film.set_initial_radii(radii);
    for (int i = 0; i < 7; ++i) {
      static_cast<void>(film.sums().add(random_result(i)));
      film.close_round_if_complete();
    }
    return film;
  }
};

TEST_F(Checkpoint, HoldsAFilmWholeInTheMiddleOfARound) {
  const Film film = some_film();
  ASSERT_NE(film.sub_passes(), film.round_begin()) << "the round should be open";
  ASSERT_TRUE(film.save(file_, "job a"));
  auto loaded = Film::load(file_, "job a");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->sub_passes(), film.sub_passes());
  EXPECT_EQ(loaded->round_begin(), film.round_begin());
  const LayeredImage a = film.image();
  const LayeredImage b = loaded->image();
  for (std::size_t i = 0; i < a.layers.size(); ++i) EXPECT_EQ(a.layers[i].data, b.layers[i].data) << a.layers[i].name;
}

TEST_F(Checkpoint, OfAnotherJobIsRefused) {
  ASSERT_TRUE(some_film().save(file_, "job a"));
  const auto loaded = Film::load(file_, "job b");
  ASSERT_FALSE(loaded);
  EXPECT_NE(loaded.error().message.find("another job"), std::string::npos);
}

TEST_F(Checkpoint, DamagedAnywhereIsRefused) {
  ASSERT_TRUE(some_film().save(file_, "job a"));
  const std::string bytes = bytes_of(file_);
  for (std::size_t i = 0; i < bytes.size(); i += 7) {
    std::string broken = bytes;
    broken[i] = static_cast<char>(broken[i] ^ 0x10);
    std::ofstream(file_, std::ios::binary) << broken;
    ASSERT_FALSE(Film::load(file_, "job a")) << "byte " << i;
  }
  for (std::size_t length = 0; length < bytes.size(); length += 11) {
    std::ofstream(file_, std::ios::binary) << bytes.substr(0, length);
    ASSERT_FALSE(Film::load(file_, "job a")) << "length " << length;
  }
}

}  // namespace
}  // namespace pf
