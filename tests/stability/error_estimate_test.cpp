// The error that SPPM and PPM say they have, against the error that they have.
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"

namespace pf::test {
namespace {

constexpr int kSide = 24;

JobSpec estimating_job(IntegratorType type, std::uint64_t seed) {
  JobSpec spec = job(kSide, kSide, type, 4000);
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
  JobSpec spec = job(kSide, kSide, IntegratorType::kPath);
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

/// How often the truth lies in the interval of [Hachisuka, Jarosz and Jensen 2010, (4)]: value less bias, plus and
/// minus t standard deviations. Taking the bias off doubles the photons' standard deviation (the kernel is then 4 - 6
/// u).
TEST(ErrorEstimate, IntervalsHoldTheTruthAsOftenAsTheySay) {
  const auto scene = diffuse_box().build();
  const std::vector<double> truth = reference(*scene);
  for (const IntegratorType type : {IntegratorType::kSppm, IntegratorType::kPpm}) {
    std::vector<double> within_one, within_two;
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      const Judged j = judged(render(*scene, estimating_job(type, seed), 24));
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
    // A pixel of PPM is the mean over its hit points, whose deviations are added up as if they found the same photons.
    if (type == IntegratorType::kSppm) {
      EXPECT_LT(one.mean, 0.95);
    }
    EXPECT_GT(two.mean, 0.90);
  }
}

/// A floor under a small bright patch at height 1, itself lit by a spot light: light on the floor falls off smoothly as
/// 1 / (1 + r^2)^2, and all of it comes by photons. Nothing else is in the discs' way.
SceneMaker patch_over_floor() {
  SceneMaker maker;
  maker.quad({-4, 0, 4}, {8, 0, 0}, {0, 0, -8}, maker.lambert({0.5f, 0.5f, 0.5f}));
  maker.quad({-0.2f, 1, -0.2f}, {0.4f, 0, 0}, {0, 0, 0.4f}, maker.lambert({0.9f, 0.9f, 0.9f}));
  maker.spot_light({0, 0.6f, 0}, {0, 1, 0}, 10.0f, 0.97f, 0.95f);
  maker.orthographic_camera({0, 0.95f, 0}, {0, 0, 0}, 0.8f, 0.8f);
  return maker;
}

/// With discs as wide as a third of the patch's height the error is bias: 9 % too dark in the middle. What is estimated
/// must be what is there; the next order of the flux density, which no quadratic sees, is a few per cent of it.
TEST(ErrorEstimate, FindsTheBiasOfWideDiscs) {
  const auto scene = patch_over_floor().build();
  const std::vector<double> truth = reference(*scene);
  std::vector<double> slopes;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    JobSpec spec = estimating_job(IntegratorType::kSppm, seed);
    spec.integrator.initial_radius = 0.3;
    spec.integrator.photons = 50000;
    const Judged one = judged(render(*scene, spec, 2));
    spec.integrator.seed += 100;
    const Judged other = judged(render(*scene, spec, 2));
    // Of independent runs, so that neither their noise nor the truth's is in the sums' means.
    double error_by_bias = 0, bias2 = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      error_by_bias += one.bias[i] * (other.value[i] - truth[i]);
      bias2 += one.bias[i] * other.bias[i];
    }
    slopes.push_back(error_by_bias / bias2);
  }
  const Estimate slope = estimate(slopes);
  std::printf("true error per estimated bias: %.3f +- %.3f\n", slope.mean, slope.error);
  EXPECT_TRUE(agrees(slope, 1.0, 0.15));
}

}  // namespace
}  // namespace pf::test
