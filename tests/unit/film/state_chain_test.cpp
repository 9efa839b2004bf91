// The chain of hashes that says through which states a film went.

#include <set>

#include <gtest/gtest.h>

#include "common/film/film.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

Film new_film() {
  Film film({3, 2, Estimator::kShared, SumScale::from_scene(2.0, 1e-5, 3.0), 2.0 / 3.0, 0.25});
  std::vector<ProgressivePixel> radii(6);
  for (ProgressivePixel& pixel : radii) pixel[kCaustic].radius2 = pixel[kIndirect].radius2 = 0.25f;
  film.set_initial_radii(radii);
  return film;
}

void add(Film& film, std::uint64_t sub_passes) {
  for (std::uint64_t i = 0; i < sub_passes; ++i) {
    PixelSums& pixel = film.sums().pixels[film.sub_passes() % 6];
    pixel.photons[kIndirect] += 3;
    pixel.flow[kIndirect][0] += 1000;
    ++film.sums().sub_passes;
  }
}

TEST(StateChain, IsTheSameWhetherARoundCameWholeOrBitByBit) {
  Film whole = new_film(), bits = new_film();
  std::set<std::string> links = {whole.round_chain()};
  while (whole.sub_passes() < 30) {
    const std::uint64_t count = whole.round_end() - whole.sub_passes();
    add(whole, count);
    whole.close_round_if_complete();
    for (std::uint64_t i = 0; i < count; ++i) {
      add(bits, 1);
      bits.close_round_if_complete();
    }
    EXPECT_EQ(whole.round_chain(), bits.round_chain());
    EXPECT_TRUE(links.insert(whole.round_chain()).second) << "every round adds a link";
  }
  EXPECT_EQ(whole.state_chain(), bits.state_chain());
  add(bits, 1);
  EXPECT_EQ(whole.round_chain(), bits.round_chain());
  EXPECT_NE(whole.state_chain(), bits.state_chain()) << "the open round counts too";
}

TEST(StateChain, KeepsADifferenceForEverAndSurvivesACheckpoint) {
  const TempFolder folder;
  Film a = new_film(), b = new_film();
  for (Film* film : {&a, &b}) add(*film, film->round_end());
  b.sums().pixels[0].flow[kIndirect][1] += 1;
  for (Film* film : {&a, &b}) film->close_round_if_complete();
  EXPECT_NE(a.round_chain(), b.round_chain());
  ASSERT_TRUE(a.save(folder / "film", "job"));
  auto loaded = Film::load(folder / "film", "job");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->round_chain(), a.round_chain());
  EXPECT_EQ(loaded->state_chain(), a.state_chain());
  for (Film* film : {&a, &*loaded}) {
    add(*film, film->round_end() - film->sub_passes());
    film->close_round_if_complete();
  }
  EXPECT_EQ(loaded->round_chain(), a.round_chain());
}

}  // namespace
}  // namespace pf
