#include "worker/photon/photon_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "common/math/philox.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

/// Photons in a dense spot, spread over a floor, on the floor's underside and on a wall.
PhotonArrays some_photons(int count) {
  PathRng rng(3, Stream::kTest, 0, 0);
  PhotonArrays photons;
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
    photons.push(position, flux, sample_sphere(rng.next2()), normal);
  }
  return photons;
}

bool accepts(const DiscQuery& q, const PhotonArrays& p, std::size_t i) {
  const Vec3f d = Vec3f{p.x[i], p.y[i], p.z[i]} - q.position;
  if (d.x * d.x + d.y * d.y + d.z * d.z > q.radius2) return false;
  if (std::abs(d.x * q.normal.x + d.y * q.normal.y + d.z * q.normal.z) > kPlaneTolerance * std::sqrt(q.radius2)) return false;
  const auto byte = [&](int k) { return static_cast<float>(static_cast<std::int8_t>(p.normal[i] >> (8 * k))); };
  float facing = byte(0) * q.normal.x + byte(1) * q.normal.y + byte(2) * q.normal.z;
  if (q.both_sides) facing = std::abs(facing);
  return facing >= kMinNormalCosine * kNormalSteps;
}

FluxSum brute_force(const DiscQuery& q, const PhotonArrays& p) {
  FluxSum sum;
  for (std::size_t i = 0; i < p.size(); ++i) {
    if (!accepts(q, p, i)) continue;
    ++sum.count;
    for (std::size_t c = 0; c < 3; ++c) {
      const float f = c == 0 ? p.r[i] : c == 1 ? p.g[i] : p.b[i];
      sum.steps[c] += std::llrint(static_cast<double>(f) * kFluxSteps);
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
  const PhotonArrays photons = some_photons(GetParam());
  PhotonTree tree{PhotonArrays(photons)};
  PathRng rng(5, Stream::kTest, 0, 1);
  for (int i = 0; i < 400; ++i) {
    DiscQuery q;
    q.position = Vec3f{rng.next1() - 0.5f, 0.02f * (rng.next1() - 0.5f), rng.next1() - 0.5f} * (i % 2 == 0 ? 1.0f : 0.02f);
    // Neighbouring queries whose radii differ by a factor of a hundred, some of them reaching over all photons.
    const float radius = i % 4 == 0 ? 0.003f : i % 4 == 1 ? 0.3f : i % 4 == 2 ? 3.0f : 0.03f;
    q.radius2 = radius * radius;
    q.normal = i % 5 == 0 ? Vec3f{0, -1, 0} : i % 5 == 1 ? Vec3f{1, 0, 0} : normalize({0.1f, 1.0f, -0.2f});
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

INSTANTIATE_TEST_SUITE_P(Sizes, PhotonTreeOfSize, testing::Values(0, 1, 15, 16, 17, 255, 257, 4097, 30000));

TEST(PhotonTree, SumsOfPhotonsOfAnyStrengthAreExact) {
  // Sums of 32 bits hold a few blocks, one block, or not even a photon.
  for (const float strength : {1.0f, 10.0f, 40.0f, 130.0f, 1e5f}) {
    PhotonArrays photons = some_photons(5000);
    for (auto* channel : {&photons.r, &photons.g, &photons.b}) {
      for (float& flux : *channel) flux *= strength;
    }
    PhotonTree tree{PhotonArrays(photons)};
    const DiscQuery q{{0, 0, 0}, {0, 1, 0}, 1.0f, false};
    const FluxSum expected = brute_force(q, photons);
    for (const PhotonTree::Isa isa : isas()) {
      tree.use_isa(isa);
      EXPECT_EQ(tree.sum_flux(q).steps, expected.steps) << strength;
    }
  }
}

TEST(PhotonTree, FindsPhotonsAtTheEdgeOfTheirBounds) {
  const PhotonArrays photons = some_photons(2000);
  const PhotonTree tree{PhotonArrays(photons)};
  for (std::size_t i = 0; i < photons.size(); i += 17) {
    DiscQuery q;
    const Vec3f p{photons.x[i], photons.y[i], photons.z[i]};
    q.normal = Vec3f{0, 1, 0};
    q.radius2 = 1e-4f;
    // Outside the bounding box of all photons, but nearer than the radius.
    q.position = p + Vec3f{p.x > 0 ? 0.009f : -0.009f, 0.0f, 0.0f};
    ASSERT_EQ(tree.count(q), brute_force(q, photons).count);
  }
}

TEST(PhotonTree, AcceptsAllPhotonsAtOnePlace) {
  PhotonArrays photons;
  for (int i = 0; i < 1000; ++i) photons.push({1, 2, 3}, {1, 1, 1}, {0, 1, 0}, {0, 1, 0});
  const PhotonTree tree(std::move(photons));
  EXPECT_EQ(tree.count({{1, 2, 3}, {0, 1, 0}, 1e-12f, false}), 1000u);
  EXPECT_EQ(tree.count({{1, 2, 3.1f}, {0, 1, 0}, 1e-12f, false}), 0u);
}

TEST(PhotonTree, SumsDoNotDependOnTheOrderOfPhotons) {
  const PhotonArrays photons = some_photons(5000);
  PhotonArrays reversed;
  for (std::size_t i = photons.size(); i-- > 0;) {
    reversed.push({photons.x[i], photons.y[i], photons.z[i]}, {photons.r[i], photons.g[i], photons.b[i]},
                  unpack_direction(photons.direction[i]), {0, 1, 0});
    reversed.normal.back() = photons.normal[i];
  }
  const PhotonTree a{PhotonArrays(photons)};
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
