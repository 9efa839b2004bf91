#include "worker/integrators/first_radius.h"

#include <gtest/gtest.h>

#include <utility>

#include "common/math/philox.h"
#include "common/math/sampling.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"

namespace pf::test {
namespace {

constexpr float kRadius2 = 0.01f;
const DiscQuery kQuery{{0, 0, 0}, {0, 1, 0}, 0.0f, false};

/// Photons on a floor around the origin, of a flux that follows from where they lie.
template <typename Flux>
PhotonTree floor_of(std::uint64_t seed, Flux flux) {
  constexpr int kPhotons = 2000;
  PathRng rng(seed, Stream::kTest, 0, 0);
  Photons photons;
  for (int i = 0; i < kPhotons; ++i) {
    const Vec2f at = (rng.next2() - Vec2f(0.5f, 0.5f)) * 0.4f;
    photons.push_back(make_photon({at.x, 0, at.y}, Rgb{1, 1, 1} * flux(at), {0, 1, 0}, {0, 1, 0}));
  }
  return PhotonTree(std::move(photons));
}

/// Part of such floors on which the disc is widened.
template <typename Flux>
double widened(Flux flux, double fixed = 0) {
  constexpr int kFloors = 400;
  int wide = 0;
  for (std::uint64_t seed = 0; seed < kFloors; ++seed) {
    const PhotonTree tree = floor_of(seed, flux);
    GatherCursor photons(tree);
    const float radius2 = FirstRadius{fixed, 1.0f, 1e5}.widened(photons, kQuery, kRadius2);
    EXPECT_TRUE(radius2 == kRadius2 || radius2 == kWidening * kRadius2) << radius2;
    if (radius2 > kRadius2) ++wide;
  }
  return wide / double{kFloors};
}

TEST(FirstRadius, LiesWithinFootprintsAndAPartOfTheScene) {
  const RadiusRule rule{400.0f, 1.0f, 16.0f};
  const RadiusBounds near = radius_bounds(rule, 0.01f, 10.0f);
  EXPECT_FLOAT_EQ(near.smallest, 0.01f);
  EXPECT_FLOAT_EQ(near.largest, 0.16f);
  const RadiusBounds far = radius_bounds(rule, 1.0f, 10.0f);
  EXPECT_FLOAT_EQ(far.largest, 0.5f);
  EXPECT_FLOAT_EQ(far.smallest, far.largest);
}

TEST(FirstRadius, IsWidenedWhereLightIsTheSameOrRisesEvenly) {
  // Chance keeps 0.012 of them narrow, beyond 2.5 standard deviations.
  EXPECT_NEAR(widened([](const Vec2f&) { return 1.0f; }), 0.988, 0.02);
  EXPECT_NEAR(widened([](const Vec2f& at) { return 1.0f + 4.0f * at.x; }), 0.988, 0.02);
}

TEST(FirstRadius, StaysWhereTheMiddleIsBrighterOrDarkerThanTheDisc) {
  const auto inside = [](const Vec2f& at) { return at.x * at.x + at.y * at.y < 0.25f * kRadius2; };
  EXPECT_LT(widened([&](const Vec2f& at) { return inside(at) ? 4.0f : 1.0f; }), 0.01);
  EXPECT_LT(widened([&](const Vec2f& at) { return inside(at) ? 0.0f : 1.0f; }), 0.01);
}

TEST(FirstRadius, StaysAsTheJobSays) {
  EXPECT_EQ(widened([](const Vec2f&) { return 1.0f; }, 0.1), 0.0);
}

TEST(FirstRadius, IsWidenedOnlyWhereTheSurfaceReachesSoFar) {
  const auto scene = corner_room().build();
  const JobSpec spec = job(64, 48, IntegratorType::kSppm, 2000);
  // The rule's discs are at most this wide in a room whose half diagonal is sqrt(3) m.
  constexpr float kLargest2 = 0.05f * 0.05f * 3.0f;
  const auto state = make_integrator(*scene, spec)->initial_radii();
  std::size_t widened = 0;
  for (const ProgressivePixel& pixel : state) {
    const float radius2 = pixel[kIndirect].radius2;
    EXPECT_LE(radius2, 1.0001f * kWidening * kLargest2);
    if (radius2 <= 1.0001f * kLargest2) continue;
    ++widened;
    EXPECT_GE(pixel.covered_radius * pixel.covered_radius, radius2);
  }
  EXPECT_GT(widened, state.size() / 10);
  EXPECT_LT(widened, state.size());
}

}  // namespace
}  // namespace pf::test
