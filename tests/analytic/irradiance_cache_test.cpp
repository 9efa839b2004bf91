// Irradiance caching against closed forms and against path tracing.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/integrators/irradiance_cache.h"

namespace pf::test {
namespace {

JobSpec cached(int width, int height, double error = 0.15, int rays = 256) {
  JobSpec spec = job(width, height, IntegratorType::kIrradianceCache);
  spec.irradiance_cache.source = GatherSource::kPath;
  spec.irradiance_cache.error = error;
  spec.irradiance_cache.rays = rays;
  spec.irradiance_cache.min_spacing = 1.5;  // of images of few pixels
  spec.photon_map.caustic_photons = 1000;   // nothing is specular but where a test says so
  return spec;
}

/// A layer by several seeds, as means over blocks of pixels.
std::vector<Estimate> blocks_of(const Scene& scene, const JobSpec& spec, std::uint64_t passes, int runs, int edge,
                                std::string_view layer) {
  const int columns = spec.image.width / edge, rows = spec.image.height / edge;
  std::vector<std::vector<double>> values(static_cast<std::size_t>(columns * rows));
  for (int run = 0; run < runs; ++run) {
    JobSpec seeded = spec;
    const bool path = spec.integrator.type == IntegratorType::kPath;
    seeded.integrator.seed = static_cast<std::uint64_t>(run) + (path ? 1000u : 2000u);
    const Film film = path ? render(scene, seeded, passes)
                           : render(IrradianceCacheIntegrator(scene, scene.cameras().front(), seeded), passes);
    EXPECT_EQ(film.sums().faults.not_finite, 0u);
    const std::vector<Rgb> image = layer_of(film, layer);
    for (int block = 0; block < columns * rows; ++block) {
      double sum = 0.0;
      for (int i = 0; i < edge * edge; ++i) {
        const int x = block % columns * edge + i % edge, y = block / columns * edge + i / edge;
        sum += double{average(image[static_cast<std::size_t>(y * spec.image.width + x)])};
      }
      values[static_cast<std::size_t>(block)].push_back(sum / (edge * edge));
    }
  }
  std::vector<Estimate> estimates;
  for (const auto& v : values) estimates.push_back(estimate(v));
  return estimates;
}

TEST(IrradianceCaching, GivesAFurnaceItsRadianceInEveryPixel) {
  for (const float rho : {0.5f, 0.8f}) {
    SceneMaker maker;
    maker.box({-0.5f, -0.5f, -0.5f}, {0.5f, 0.5f, 0.5f}, maker.emitter({1, 1, 1}, {rho, rho, rho}), true);
    maker.camera({0.2f, 0.1f, 0.15f}, {-0.5f, -0.5f, -0.5f}, 1.6f);
    const auto scene = maker.build();
    JobSpec spec = cached(12, 12, 0.15, 128);
    spec.integrator.max_depth = 0;
    const double expected = 1.0 / (1.0 - double{rho});
    EXPECT_TRUE(all_agree(blocks_of(*scene, spec, 16, 8, 1, ""), std::vector<double>(144, expected)));
  }
}

TEST(IrradianceCaching, IsCutAfterTheDepthThatTheJobAsksFor) {
  const auto scene = furnace_box().build();
  for (const int depth : {1, 2, 4}) {
    JobSpec spec = cached(6, 6, 0.15, 64);
    spec.integrator.max_depth = depth;
    const double expected = (1.0 - std::pow(0.5, depth + 1)) / 0.5;
    EXPECT_TRUE(all_agree(blocks_of(*scene, spec, 16, 8, 3, ""), std::vector<double>(4, expected))) << depth;
  }
}

/// Light that one wall of radiance L = rho E / pi throws on a floor point: a wall lit evenly by a directional
/// light is seen under the configuration factor of a perpendicular rectangle.
TEST(IrradianceCaching, OfAFloorBesideALitWallIsItsConfigurationFactor) {
  // Light along -x meets the wall x = 0 only, the floor not at all (it lies along the light), and nothing
  // else is there.
  SceneMaker maker;
  constexpr float kRho = 0.5f, kSide = 4.0f;
  const int grey = maker.lambert({kRho, kRho, kRho});
  maker.quad({0, 0, -0.5f * kSide}, {0, kSide, 0}, {0, 0, kSide}, grey);
  maker.quad({0, 0, -0.5f * kSide}, {0, 0, kSide}, {kSide, 0, 0}, grey);
  maker.directional_light({-1, 0, 0}, 2.0f);
  maker.orthographic_camera({1, 3, 0}, {1, 0, 0}, 0.8f, 0.8f);
  const auto scene = maker.build();
  JobSpec spec = cached(16, 16, 0.1, 512);
  spec.integrator.max_depth = 2;  // sun, wall, floor
  const auto measured = blocks_of(*scene, spec, 8, 8, 4, "indirect");
  // Element to a rectangle perpendicular to it whose edge lies in its plane, at the corner [Howell, B-4]:
  // with b along the edge, c the height, a the distance, F = (atan(b/a) - a / sqrt(a^2 + c^2) atan(b /
  // sqrt(a^2 + c^2))) / (2 pi).
  const auto factor = [](double a, double b, double c) {
    const double d = std::sqrt(a * a + c * c);
    return (std::atan(b / a) - a / d * std::atan(b / d)) / (2.0 * double{kPi});
  };
  std::vector<double> expected;
  constexpr int kFine = 40;  // of a block's 0.4 m
  for (int block = 0; block < 16; ++block) {
    double sum = 0.0;
    for (int i = 0; i < kFine * kFine; ++i) {
      const double x = 0.2 + 0.4 * (block % 4 + (i % kFine + 0.5) / kFine);
      const double z = -0.8 + 0.4 * (block / 4 + (i / kFine + 0.5) / kFine);
      sum += factor(x, 2.0 - z, 4.0) + factor(x, 2.0 + z, 4.0);
    }
    const double wall = double{kRho} * 2.0 / double{kPi};
    expected.push_back(double{kRho} * wall * sum / (kFine * kFine));
  }
  constexpr double kInterpolation = 0.01;
  EXPECT_TRUE(all_agree(measured, expected, kInterpolation));
}

TEST(IrradianceCaching, AgreesWithPathTracing) {
  const auto scene = diffuse_box().build();
  JobSpec path = job(24, 24, IntegratorType::kPath);
  constexpr double kInterpolation = 0.02;  // of indirect light in blocks, at error 0.15
  const auto reference = blocks_of(*scene, path, 96, 8, 4, "indirect");
  const auto measured = blocks_of(*scene, cached(24, 24), 8, 8, 4, "indirect");
  EXPECT_TRUE(all_agree(measured, reference, kInterpolation, 2e-4));
}

TEST(IrradianceCaching, AgreesWithPathTracingOnRoughAndGlossySurfaces) {
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.lambert({0.5f, 0.5f, 0.5f}), true);
  maker.quad({-0.4f, 0.99f, -0.4f}, {0.8f, 0, 0}, {0, 0, 0.8f}, maker.emitter({5, 5, 5}));
  maker.sphere({-0.4f, -0.6f, -0.2f}, 0.38f, maker.metal({0.9f, 0.8f, 0.6f}, 0.8f), 24);
  maker.sphere({0.45f, -0.6f, -0.1f}, 0.38f, maker.plastic({0.3f, 0.4f, 0.6f}, 0.9f), 24);
  maker.camera({0, 0, 0.95f}, {0, -0.1f, 0}, 1.1f);
  const auto scene = maker.build();
  // Wide lobes: hardly any light arrives by what counts as a mirror.
  const auto reference = blocks_of(*scene, job(24, 24, IntegratorType::kPath), 96, 8, 4, "");
  const auto measured = blocks_of(*scene, cached(24, 24), 16, 8, 4, "");
  EXPECT_TRUE(all_agree(measured, reference, 0.02, 2e-3));
}

TEST(IrradianceCaching, AddsCausticsAndSpecularPathsToWhatPathTracingGives) {
  // A mirror ball and a glass ball under a lamp that path tracing finds as well.
  SceneMaker maker = peer_box(16);
  const auto scene = maker.build();
  JobSpec spec = cached(24, 24, 0.15, 128);
  spec.photon_map.caustic_photons = 50000;
  const auto reference = blocks_of(*scene, job(24, 24, IntegratorType::kPath), 128, 5, 8, "");
  // Blur of the caustic's estimate, and light of caustics that surfaces pass on, in blocks of 8 x 8 pixels.
  for (const GatherSource source : {GatherSource::kPath, GatherSource::kPhotonMap}) {
    spec.irradiance_cache.source = source;
    spec.integrator.photons = 50000;
    EXPECT_TRUE(all_agree(blocks_of(*scene, spec, 8, 4, 8, ""), reference, 0.04, 0.005)) << static_cast<int>(source);
  }
}

TEST(IrradianceCaching, ErrsLessTheSmallerItsErrorIs) {
  // Indirect light that changes fast: a bright spot on a wall near the floor.
  SceneMaker maker;
  const int grey = maker.lambert({0.7f, 0.7f, 0.7f});
  maker.quad({0, 0, -2}, {0, 2, 0}, {0, 0, 4}, grey);
  maker.quad({0, 0, -2}, {0, 0, 4}, {3, 0, 0}, grey);
  maker.spot_light({2, 0.3f, 0}, {-1, -0.02f, 0}, 10.0f, 0.995f, 0.99f);
  maker.orthographic_camera({0.8f, 3, 0}, {0.8f, 0, 0}, 0.7f, 0.7f);
  const auto scene = maker.build();
  JobSpec path = job(32, 32, IntegratorType::kPath);
  path.integrator.max_depth = 2;
  const auto reference = layer_of(render(*scene, path, 3000), "indirect");
  std::vector<double> errors;
  for (const double error : {1.0, 0.6, 0.3}) {
    JobSpec spec = cached(32, 32, error, 32768);  // their noise shall not be seen
    spec.integrator.max_depth = 2;
    spec.irradiance_cache.min_spacing = 0.5;
    const auto image =
        layer_of(render(IrradianceCacheIntegrator(*scene, scene->cameras().front(), spec), 16), "indirect");
    double sum = 0.0;
    for (std::size_t i = 0; i < image.size(); ++i) {
      const double relative = double{image[i].x - reference[i].x} / (double{reference[i].x} + 0.01);
      sum += relative * relative / static_cast<double>(image.size());
    }
    errors.push_back(std::sqrt(sum));
  }
  EXPECT_LT(errors[1], errors[0]) << errors[0] << ' ' << errors[1] << ' ' << errors[2];
  EXPECT_LT(errors[2], errors[1]) << errors[0] << ' ' << errors[1] << ' ' << errors[2];
}

}  // namespace
}  // namespace pf::test
