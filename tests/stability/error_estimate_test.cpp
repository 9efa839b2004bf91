// The error that SPPM and PPM say they have, against the error that they have.
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"

namespace pf::test {
namespace {

constexpr int kEdge = 24;

JobSpec estimating_job(IntegratorType type, std::uint64_t seed) {
  JobSpec spec = job(kEdge, kEdge, type, 4000);
  spec.integrator.error_estimate = true;
  spec.integrator.seed = seed;
  spec.integrator.max_depth = 0;
  spec.ppm.eye_samples = 16;
  spec.ppm.hit_points = 16;
  return spec;
}

std::vector<double> luminances(const std::vector<Rgb>& pixels) {
  std::vector<double> all;
  for (const Rgb& p : pixels) all.push_back(luminance(p));
  return all;
}

std::vector<double> reference(const Scene& scene) {
  JobSpec spec = job(kEdge, kEdge, IntegratorType::kPath);
  spec.integrator.seed = 7001;
  spec.integrator.max_depth = 0;
  return luminances(layer_of(render(scene, spec, 4096)));
}

struct Judged {
  std::vector<double> value, noise, bias;
};
Judged judged(const Film& film) {
  const LayeredImage image = film.image();
  Judged j;
  j.value = luminances(layer_of(film));
  const std::vector<float>& error = image.find("error")->data;
  for (std::size_t i = 0; i < error.size(); i += 2) {
    j.noise.push_back(error[i]);
    j.bias.push_back(error[i + 1]);
  }
  return j;
}

/// How often the truth lies in the interval of [Hachisuka, Jarosz and Jensen 2010, (4)]: value less bias, plus and minus t
/// standard deviations. Taking the bias off doubles the photons' standard deviation (the kernel is then 4 - 6 u).
TEST(ErrorEstimate, IntervalsHoldTheTruthAsOftenAsTheySay) {
  const auto scene = diffuse_box().build();
  const std::vector<double> truth = reference(*scene);
  for (const IntegratorType type : {IntegratorType::kSppm, IntegratorType::kPpm}) {
    std::vector<double> within_one, within_two;
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      const Judged j = judged(render(*scene, estimating_job(type, seed), 48));
      double one = 0, two = 0;
      for (std::size_t i = 0; i < truth.size(); ++i) {
        const double off = std::abs(j.value[i] - j.bias[i] - truth[i]);
        one += off <= 2.0 * j.noise[i];
        two += off <= 4.0 * j.noise[i];
      }
      within_one.push_back(one / static_cast<double>(truth.size()));
      within_two.push_back(two / static_cast<double>(truth.size()));
    }
    const Estimate one = estimate(within_one), two = estimate(within_two);
    std::printf("%s: within one standard deviation %.3f +- %.3f, within two %.3f +- %.3f\n",
                std::string(to_string(type)).c_str(), one.mean, one.error, two.mean, two.error);
    // Of a normal distribution 0.683 and 0.954; direct light's noise is counted twice too, which widens the interval.
    EXPECT_GT(one.mean, 0.60);
    EXPECT_LT(one.mean, 0.95);
    EXPECT_GT(two.mean, 0.90);
  }
}

/// With discs as wide as a quarter of the room the error is nearly all bias: what the estimate takes off must bring it down.
TEST(ErrorEstimate, FindsTheBiasOfWideDiscs) {
  const auto scene = diffuse_box().build();
  const std::vector<double> truth = reference(*scene);
  const auto integrator_of = [&](std::uint64_t seed) {
    JobSpec spec = estimating_job(IntegratorType::kSppm, seed);
    spec.integrator.initial_radius = 0.12;
    spec.integrator.photons = 20000;
    return spec;
  };
  std::vector<double> value(truth.size()), bias(truth.size());
  constexpr int kSeeds = 8;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const Judged j = judged(render(*scene, integrator_of(seed), 2));
    for (std::size_t i = 0; i < truth.size(); ++i) {
      value[i] += j.value[i] / kSeeds;
      bias[i] += j.bias[i] / kSeeds;
    }
  }
  double covariance = 0, bias2 = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    covariance += bias[i] * (value[i] - truth[i]);
    bias2 += bias[i] * bias[i];
  }
  const double slope = covariance / bias2;
  std::printf("true error per estimated bias: %.3f\n", slope);
  EXPECT_GT(slope, 0.5);
  EXPECT_LT(slope, 1.5);
}

}  // namespace
}  // namespace pf::test
