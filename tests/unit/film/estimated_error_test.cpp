// What Film::estimated_error makes of noise and of bias, on films whose sums are written down by hand.

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "common/film/film.h"

namespace pf {
namespace {

constexpr std::uint64_t kSubPasses = 4;
constexpr std::uint32_t kPhotons = 100;           // of a pixel: a relative variance of 1 / 100
constexpr double kNoise = 1.0 / kPhotons / 1.01;  // of radiance 1, as relMSE weighs it

/// Every pixel has radiance 1 from kPhotons photons, and as bias what `biases` says of it.
Film film_of(const std::vector<double>& biases, Extra extra = Extra::kBias) {
  FilmOptions options{static_cast<int>(biases.size()), 1, Estimator::kIndependent, {}, 2.0 / 3.0, 0.25};
  options.extra = extra;
  Film film(options);
  Statistics& sums = film.sums();
  sums.sub_passes = kSubPasses;
  const double steps = static_cast<double>(kSubPasses) / options.scale.flow;
  for (std::size_t i = 0; i < biases.size(); ++i) {
    sums.pixels[i].flow[kIndirect].fill(std::llround(steps));
    sums.pixels[i].photons[kIndirect] = kPhotons;
    if (extra == Extra::kBias) sums.extras[i].rgb[kIndirect] = std::llround(biases[i] * steps);
  }
  return film;
}

TEST(EstimatedError, IsTheNoiseWhereNoBiasIsLookedFor) {
  EXPECT_NEAR(film_of({0, 0}, Extra::kNone).estimated_error(), std::sqrt(kNoise), 1e-6);
}

TEST(EstimatedError, StaysTheNoiseWhereTheBiasFoundIsLessThanItsOwnNoise) {
  // A bias of nothing, found from 100 photons: its square should have been 3 / 100, and taking that off leaves less
  // than nothing.
  EXPECT_NEAR(film_of({0, 0, 0, 0}).estimated_error(), std::sqrt(kNoise), 1e-6);
}

TEST(EstimatedError, AddsTheBiasLessWhatItsNoisePretends) {
  const double bias2 = (0.5 * 0.5 - 3.0 / kPhotons) / 1.01;
  EXPECT_NEAR(film_of({0.5, -0.5}).estimated_error(), std::sqrt(kNoise + bias2), 1e-6);
}

TEST(EstimatedError, LetsTheBiasesNoiseCancelAmongPixelsBeforeItSaysThatThereIsNone) {
  const double twice =
      std::sqrt(2.0 * 3.0 / kPhotons);  // noise alone, once above and once below what is expected of it
  EXPECT_NEAR(film_of({twice, 0}).estimated_error(), std::sqrt(kNoise), 1e-6);
}

}  // namespace
}  // namespace pf
