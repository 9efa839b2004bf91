// How the progressive estimate converges: at which rate, whatever the size of rounds, in both modes, from any
// radius. All against the path tracer, whose own noise is known and taken off; small images, several seeds,
// t-tests.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"

namespace pf::test {
namespace {

constexpr int kEdge = 16;                ///< pixels: light is smooth enough for that
constexpr std::int64_t kPhotons = 2000;  ///< paths of a sub-pass

/// Light that photons bring, pixel by pixel: the beauty without the direct light, whose error falls as 1/N
/// from the eye samples alone and would hide the rate of the photons.
std::vector<Rgb> gathered_light(const Film& film) {
  std::vector<Rgb> sum = layer_of(film, "caustics");
  const std::vector<Rgb> indirect = layer_of(film, "indirect");
  for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += indirect[i];
  return sum;
}

/// What the path tracer says, in halves: the product of the differences to two independent halves has no part
/// of the reference's own noise in its mean.
struct Reference {
  std::array<std::vector<Rgb>, 2> half;
};

Reference make_reference(const Scene& scene, std::uint64_t samples) {
  Reference reference;
  for (std::size_t h = 0; h < 2; ++h) {
    JobSpec spec = job(kEdge, kEdge, IntegratorType::kPath);
    spec.integrator.seed = 9001 + h;
    spec.integrator.max_depth = 0;
    reference.half[h] = gathered_light(render(scene, spec, samples / 2));
  }
  return reference;
}

/// Mean squared error of an image, over pixels and channels, without bias from the reference's noise.
double squared_error(const std::vector<Rgb>& image, const Reference& reference) {
  double sum = 0.0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const double x = image[i][c];
      sum += (x - double{reference.half[0][i][c]}) * (x - double{reference.half[1][i][c]});
    }
  }
  return sum / (3.0 * static_cast<double>(image.size()));
}

JobSpec sppm_job(std::uint64_t seed, IntegratorType type = IntegratorType::kSppm) {
  JobSpec spec = job(kEdge, kEdge, type, kPhotons);
  spec.integrator.seed = seed;
  spec.integrator.alpha = 2.0 / 3.0;
  spec.integrator.max_depth = 0;
  spec.ppm.eye_samples =
      64;  // of PPM they never become more: what they miss of a pixel must be less than the photons' error
  spec.ppm.hit_points = 64;
  return spec;
}

/// Squared error after each of `stops` sub-passes of one run.
std::vector<double> errors_at(const Scene& scene, const JobSpec& spec, const Reference& reference,
                              const std::vector<std::uint64_t>& stops) {
  const auto integrator = make_integrator(scene, spec);
  Film film(integrator->film_options());
  film.set_initial_radii(integrator->initial_radii());
  std::vector<double> errors;
  for (const std::uint64_t stop : stops) {
    while (film.sub_passes() < stop) {
      integrator->run({film.sub_passes(), 1}, film.state(), film.sums());
      film.close_round_if_complete();
    }
    errors.push_back(squared_error(gathered_light(film), reference));
  }
  EXPECT_EQ(film.sums().faults.not_finite + film.sums().faults.overflow, 0u);
  return errors;
}

/// Slope of log(error) over log(n), least squares.
double slope_of(const std::vector<std::uint64_t>& n, const std::vector<double>& error) {
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < n.size(); ++i) {
    const double x = std::log(static_cast<double>(n[i]));
    const double y = std::log(error[i]);
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
  }
  const auto count = static_cast<double>(n.size());
  return (count * sxy - sx * sy) / (count * sxx - sx * sx);
}

void print(const char* what, const Estimate& e) {
  std::printf("%s: %.4g +- %.2g (%d runs)\n", what, e.mean, e.error, e.runs);
}

const Scene& diffuse_scene() {
  static const std::unique_ptr<const Scene> scene = diffuse_box().build();
  return *scene;
}
const Scene& peer_scene() {
  static const std::unique_ptr<const Scene> scene = peer_box(24).build();
  return *scene;
}
const Reference& diffuse_reference() {
  static const Reference reference = make_reference(diffuse_scene(), 4096);
  return reference;
}
const Reference& peer_reference() {
  static const Reference reference = make_reference(peer_scene(), 8192);
  return reference;
}

/// Variance falls as N^-alpha and squared bias as N^(-2(1-alpha)) [Knaus and Zwicker 2011, (17) and (18)]:
/// both N^(-2/3) at alpha = 2/3. Over two decades the rate is not quite reached: the first discs hold few
/// photons, and pixels at edges begin with a bias that falls later.
void expect_the_rate(const Scene& scene, const Reference& reference, int seeds,
                     IntegratorType type = IntegratorType::kSppm) {
  // A pixel of PPM is the mean over its hit points: while their discs are smaller than the pixel, noise falls faster.
  const bool ppm = type == IntegratorType::kPpm;
  const std::vector<std::uint64_t> stops =
      ppm ? std::vector<std::uint64_t>{4, 8, 16, 32, 64} : std::vector<std::uint64_t>{4, 8, 16, 32, 64, 128, 256, 400};
  std::vector<double> slopes;
  std::vector<double> mean(stops.size());
  for (int seed = 0; seed < seeds; ++seed) {
    const std::vector<double> errors =
        errors_at(scene, sppm_job(100 + static_cast<std::uint64_t>(seed), type), reference, stops);
    for (std::size_t i = 0; i < errors.size(); ++i) {
      ASSERT_GT(errors[i], 0.0) << "the reference is too noisy";
      mean[i] += errors[i] / seeds;
    }
    slopes.push_back(slope_of(stops, errors));
  }
  const Estimate slope = estimate(slopes);
  print("slope", slope);
  for (std::size_t i = 0; i < stops.size(); ++i)
    std::printf("  %4d sub-passes: %.3g\n", static_cast<int>(stops[i]), mean[i]);
  const double kSteepest = ppm ? -1.0 : -0.80, kFlattest = -0.55;
  EXPECT_LT(slope.error, ppm ? 0.06 : 0.03) << "the seeds do not say enough";
  EXPECT_GT(slope.mean + 3.0 * slope.error, kSteepest);
  EXPECT_LT(slope.mean - 3.0 * slope.error, kFlattest);
}

TEST(Convergence, SquaredErrorFallsWithTwoThirdsOfTheWorkOnDiffuseWalls) {
  expect_the_rate(diffuse_scene(), diffuse_reference(), 4);
}

TEST(Convergence, SquaredErrorFallsWithTwoThirdsOfTheWorkThroughGlassAndMirror) {
  expect_the_rate(peer_scene(), peer_reference(), 6);  // its caustics make single runs differ
}

TEST(Convergence, SquaredErrorFallsWithTwoThirdsOfTheWorkAtFixedHitPoints) {
  expect_the_rate(diffuse_scene(), diffuse_reference(), 3, IntegratorType::kPpm);
}

/// What a chain of some growth ends with, seed by seed.
struct Chains {
  Estimate error, variance;
  std::array<Estimate, kFlows> radius;
};

Chains run_chains(double growth, std::uint64_t first_seed, int seeds) {
  constexpr std::uint64_t kSubPasses = 64;
  std::vector<std::vector<Rgb>> images;
  std::vector<double> errors;
  std::array<std::vector<double>, kFlows> radii;
  for (int s = 0; s < seeds; ++s) {
    JobSpec spec = sppm_job(first_seed + static_cast<std::uint64_t>(s));
    spec.integrator.round_growth = growth;
    const Film film = render(peer_scene(), spec, kSubPasses);
    images.push_back(gathered_light(film));
    errors.push_back(squared_error(images.back(), peer_reference()));
    const LayeredImage image = film.image();
    const std::vector<float>& radius = image.find("radius")->data;
    for (const Flow flow : {kCaustic, kIndirect}) {
      double sum = 0.0;
      for (std::size_t i = flow; i < radius.size(); i += kFlows) sum += double{radius[i]};
      radii[flow].push_back(sum / static_cast<double>(radius.size() / kFlows));
    }
  }
  std::vector<Rgb> mean(images.front().size(), Rgb{0, 0, 0});
  for (const auto& image : images) {
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += image[i] / static_cast<float>(seeds);
  }
  std::vector<double> variances;
  for (const auto& image : images) {
    double sum = 0.0;
    for (std::size_t i = 0; i < mean.size(); ++i) {
      const Rgb d = image[i] - mean[i];
      sum += double{dot(d, d)};
    }
    variances.push_back(sum / (3.0 * static_cast<double>(mean.size())) * seeds / (seeds - 1.0));
  }
  return {estimate(errors), estimate(variances), {estimate(radii[kCaustic]), estimate(radii[kIndirect])}};
}

TEST(Convergence, RoundsOfAnySizeEndWithTheSameErrorVarianceAndRadius) {
  constexpr int kSeeds = 8;
  const Chains ones = run_chains(0.0, 300, kSeeds);
  for (const double growth : {0.25, 1.0}) {
    const Chains grown = run_chains(growth, growth < 0.5 ? 400 : 500, kSeeds);
    std::printf("growth %.2f against rounds of one\n", growth);
    print("  error", grown.error);
    print("  error", ones.error);
    print("  variance", grown.variance);
    print("  variance", ones.variance);
    for (const Flow flow : {kCaustic, kIndirect}) {
      print("  radius", grown.radius[flow]);
      print("  radius", ones.radius[flow]);
    }
    // A round's virtual steps take its photons as spread evenly over it, where rounds of one meet them by
    // chance. With the one or two photons a disc finds here in a sub-pass, radii end 1 % smaller at growth
    // 0.25, and 2.6 % at 1.0.
    const double radius_bias = growth < 0.5 ? 0.015 : 0.035;
    const std::array<Estimate, 2> a{grown.error, grown.variance}, b{ones.error, ones.variance};
    EXPECT_TRUE(all_agree(a, b, 2.0 * radius_bias)) << growth;
    EXPECT_TRUE(all_agree(grown.radius, ones.radius, radius_bias)) << growth;
    // And the test can tell: nothing above is hidden by noise.
    EXPECT_LT(grown.error.error, 0.1 * grown.error.mean);
    EXPECT_LT(grown.variance.error, 0.1 * grown.variance.mean);
  }
}

TEST(Convergence, IndependentPassesReachTheSameImage) {
  constexpr int kSeeds = 6;
  constexpr std::uint64_t kSubPasses = 128;
  JobSpec shared = sppm_job(1);
  JobSpec independent = shared;
  independent.integrator.mode = ProgressiveMode::kIndependent;
  const Renders a(peer_scene(), shared, kSubPasses, kSeeds);
  const Renders b(peer_scene(), independent, kSubPasses, kSeeds);
  print("shared", a.mean());
  print("independent", b.mean());
  const std::array<Estimate, 1> mean_a{a.mean()}, mean_b{b.mean()};
  EXPECT_TRUE(all_agree(mean_b, mean_a, 0.005));
  // In cells of 4 x 4 pixels: what is left of the blur of either mode stays below three percent.
  EXPECT_TRUE(all_agree(b.blocks(4, 4), a.blocks(4, 4), 0.03));
  const std::vector<double> errors = errors_at(peer_scene(), independent, peer_reference(), {8, 256});
  EXPECT_LT(errors[1], 0.25 * errors[0]);
}

TEST(Convergence, ARadiusThatIsTooLargeOrTooSmallConvergesToo) {
  // The room is 1 m wide. A disc of 20 cm blurs all; one of 4 mm finds a photon in one of a hundred
  // sub-passes.
  for (const double radius : {0.2, 0.004}) {
    for (std::uint64_t seed = 0; seed < 2; ++seed) {
      JobSpec spec = sppm_job(700 + seed);
      spec.integrator.initial_radius = radius;
      const std::vector<double> errors = errors_at(peer_scene(), spec, peer_reference(), {8, 64, 400});
      std::printf("radius %.3f: %.3g %.3g %.3g\n", radius, errors[0], errors[1], errors[2]);
      EXPECT_LT(errors[1], errors[0]);
      EXPECT_LT(errors[2], 0.6 * errors[1]);
    }
  }
}

}  // namespace
}  // namespace pf::test
