#include "worker/photon/photon_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "common/math/philox.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

/// Photons in a dense spot, spread over a floor, on the floor's underside and on a wall.
Photons some_photons(int count) {
  PathRng rng(3, Stream::kTest, 0, 0);
  Photons photons;
  for (int i = 0; i < count; ++i) {
    const float spread = i % 3 == 0 ? 0.01f : 1.0f;
    const Vec2f xz = (rng.next2() - Vec2f(0.5f, 0.5f)) * spread;
    Vec3f position{xz.x, 0.0f, xz.y};
    Vec3f normal{0, 1, 0};
    if (i % 7 == 0) normal = {0, -1, 0};
    if (i % 11 == 0) {
      normal = {1, 0, 0};
      position = {-0.5f, rng.next1(), xz.y};
    }
    const Rgb flux = Rgb{rng.next1(), rng.next1(), rng.next1()} * 3.0f;
    photons.push_back(make_photon(position, flux, sample_sphere(rng.next2()), normal));
  }
  return photons;
}

bool accepts(const DiscQuery& q, const Photon& photon) {
  const Vec3f d = photon.position - q.position;
  if (d.x * d.x + d.y * d.y + d.z * d.z > q.radius2) return false;
  if (std::abs(d.x * q.normal.x + d.y * q.normal.y + d.z * q.normal.z) > kPlaneTolerance * std::sqrt(q.radius2))
    return false;
  const auto byte = [&](int k) { return static_cast<float>(static_cast<std::int8_t>(photon.normal >> (8 * k))); };
  float facing = byte(0) * q.normal.x + byte(1) * q.normal.y + byte(2) * q.normal.z;
  if (q.both_sides) facing = std::abs(facing);
  return facing >= kMinNormalCosine * kNormalSteps;
}

FluxSum brute_force(const DiscQuery& q, const Photons& photons) {
  FluxSum sum;
  for (const Photon& photon : photons) {
    if (!accepts(q, photon)) continue;
    ++sum.count;
    for (std::size_t c = 0; c < 3; ++c) {
      sum.steps[c] += std::llrint(static_cast<double>(photon.flux[static_cast<int>(c)]) * kFluxSteps);
    }
  }
  return sum;
}

std::vector<PhotonTree::Isa> isas() {
  std::vector<PhotonTree::Isa> all{PhotonTree::Isa::kAvx2};
  if (PhotonTree::best_isa() == PhotonTree::Isa::kAvx512) all.push_back(PhotonTree::Isa::kAvx512);
  return all;
}

class PhotonTreeOfSize : public testing::TestWithParam<int> {};

TEST_P(PhotonTreeOfSize, FindsExactlyWhatBruteForceFinds) {
  const Photons photons = some_photons(GetParam());
  PhotonTree tree{Photons(photons)};
  PathRng rng(5, Stream::kTest, 0, 1);
  for (int i = 0; i < 400; ++i) {
    DiscQuery q;
    q.position =
        Vec3f{rng.next1() - 0.5f, 0.02f * (rng.next1() - 0.5f), rng.next1() - 0.5f} * (i % 2 == 0 ? 1.0f : 0.02f);
    // Neighbouring queries whose radii differ by a factor of a hundred, some of them reaching over all photons.
    const float radius = i % 4 == 0 ? 0.003f : i % 4 == 1 ? 0.3f : i % 4 == 2 ? 3.0f : 0.03f;
    q.radius2 = radius * radius;
    q.normal = i % 5 == 0 ? Vec3f{0, -1, 0} : i % 5 == 1 ? Vec3f{1, 0, 0} : normalize(Vec3f{0.1f, 1.0f, -0.2f});
    q.both_sides = i % 3 == 0;
    const FluxSum expected = brute_force(q, photons);
    for (const PhotonTree::Isa isa : isas()) {
      tree.use_isa(isa);
      const FluxSum found = tree.sum_flux(q);
      ASSERT_EQ(found.count, expected.count) << i;
      ASSERT_EQ(found.steps, expected.steps) << i;
      ASSERT_EQ(tree.count(q), expected.count);
      std::vector<std::uint32_t> indices;
      tree.collect(q, indices);
      ASSERT_EQ(indices.size(), expected.count);
      ASSERT_TRUE(std::is_sorted(indices.begin(), indices.end()));
    }
  }
}

TEST_P(PhotonTreeOfSize, ACursorFindsExactlyWhatTheTreeFinds) {
  PhotonTree tree{some_photons(GetParam())};
  for (const PhotonTree::Isa isa : isas()) {
    tree.use_isa(isa);
    GatherCursor cursor(tree);
    PathRng rng(7, Stream::kTest, 0, 3);
    Vec3f at{0, 0, 0};
    for (int i = 0; i < 3000; ++i) {
      // Small steps as from pixel to pixel, now and then a jump, and radii that change by a factor of a hundred in
      // between.
      const float step = i % 100 == 0 ? 1.0f : 0.004f;
      at += Vec3f{rng.next1() - 0.5f, 0.0f, rng.next1() - 0.5f} * step;
      const float radius = i / 37 % 3 == 0 ? 0.002f : i / 37 % 3 == 1 ? 0.02f : 0.2f;
      const DiscQuery q{at, {0, 1, 0}, radius * radius * (0.9f + 0.2f * rng.next1()), i % 3 == 0};
      const FluxSum expected = tree.sum_flux(q);
      const FluxSum found = cursor.sum_flux(q);
      ASSERT_EQ(found.count, expected.count) << i;
      ASSERT_EQ(found.steps, expected.steps) << i;
      ASSERT_EQ(cursor.count(q), expected.count) << i;
      std::vector<std::uint32_t> indices, same;
      tree.collect(q, indices);
      cursor.collect(q, same);
      ASSERT_EQ(indices, same) << i;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, PhotonTreeOfSize, testing::Values(0, 1, 15, 16, 17, 255, 257, 4097, 30000));

TEST(PhotonTree, SumsOfPhotonsOfAnyStrengthAreExact) {
  // Sums of 32 bits hold a few blocks, one block, or not even a photon.
  for (const float strength : {1.0f, 10.0f, 40.0f, 130.0f, 1e5f}) {
    Photons photons = some_photons(5000);
    for (Photon& photon : photons) photon.flux *= strength;
    PhotonTree tree{Photons(photons)};
    const DiscQuery q{{0, 0, 0}, {0, 1, 0}, 1.0f, false};
    const FluxSum expected = brute_force(q, photons);
    for (const PhotonTree::Isa isa : isas()) {
      tree.use_isa(isa);
      EXPECT_EQ(tree.sum_flux(q).steps, expected.steps) << strength;
    }
  }
}

TEST(PhotonTree, FindsPhotonsAtTheEdgeOfTheirBounds) {
  const Photons photons = some_photons(2000);
  const PhotonTree tree{Photons(photons)};
  for (std::size_t i = 0; i < photons.size(); i += 17) {
    DiscQuery q;
    const Vec3f p = photons[i].position;
    q.normal = Vec3f{0, 1, 0};
    q.radius2 = 1e-4f;
    // Outside the bounding box of all photons, but nearer than the radius.
    q.position = p + Vec3f{p.x > 0 ? 0.009f : -0.009f, 0.0f, 0.0f};
    ASSERT_EQ(tree.count(q), brute_force(q, photons).count);
  }
}

TEST(PhotonTree, AcceptsAllPhotonsAtOnePlace) {
  Photons photons;
  for (int i = 0; i < 1000; ++i) photons.push_back(make_photon({1, 2, 3}, {1, 1, 1}, {0, 1, 0}, {0, 1, 0}));
  const PhotonTree tree(std::move(photons));
  EXPECT_EQ(tree.count({{1, 2, 3}, {0, 1, 0}, 1e-12f, false}), 1000u);
  EXPECT_EQ(tree.count({{1, 2, 3.1f}, {0, 1, 0}, 1e-12f, false}), 0u);
}

TEST(PhotonTree, SumsDoNotDependOnTheOrderOfPhotons) {
  const Photons photons = some_photons(5000);
  Photons reversed(photons.rbegin(), photons.rend());
  const PhotonTree a{Photons(photons)};
  const PhotonTree b(std::move(reversed));
  const DiscQuery q{{0.01f, 0, 0.02f}, {0, 1, 0}, 0.04f, false};
  ASSERT_GT(a.count(q), 10u);
  EXPECT_EQ(a.sum_flux(q).steps, b.sum_flux(q).steps);
}

TEST(PackedDirection, KeepsDirectionsToATenthOfAMilliradian) {
  PathRng rng(9, Stream::kTest, 0, 2);
  for (int i = 0; i < 100000; ++i) {
    const Vec3f d = sample_sphere(rng.next2());
    ASSERT_LT(length(unpack_direction(pack_direction(d)) - d), 1e-4f);
  }
}

}  // namespace
}  // namespace pf
