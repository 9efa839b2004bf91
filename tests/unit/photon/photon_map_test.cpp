#include "worker/photon/photon_map.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "common/math/philox.h"
#include "common/math/sampling.h"
#include "tests/support/statistics.h"
#include "worker/photon/photon_map_filter.h"

namespace pf {
namespace {

/// Photons in a dense spot, over a floor, under it, on a wall, and many at one place.
Photons some_photons(int count) {
  PathRng rng(3, Stream::kTest, 0, 7);
  Photons photons;
  for (int i = 0; i < count; ++i) {
    const Vec2f xz = (rng.next2() - Vec2f(0.5f, 0.5f)) * (i % 3 == 0 ? 0.01f : 1.0f);
    Vec3f position{xz.x, 0.0f, xz.y}, normal{0, 1, 0};
    if (i % 7 == 0) normal = {0, -1, 0};
    if (i % 11 == 0) {
      normal = {1, 0, 0};
      position = {-0.5f, rng.next1(), xz.y};
    }
    if (i % 13 == 0) position = {0.25f, 0.0f, 0.25f};
    const Rgb flux{rng.next1(), rng.next1(), rng.next1()};
    photons.push_back(make_photon(position, flux, sample_sphere(rng.next2()), normal));
  }
  return photons;
}

PhotonMap map_of(const Photons& photons) {
  const Photons* flows[] = {&photons};
  return PhotonMap(flows);
}

NearestQuery some_query(PathRng& rng, int i) {
  NearestQuery q;
  q.position =
      Vec3f{rng.next1() - 0.5f, 0.02f * (rng.next1() - 0.5f), rng.next1() - 0.5f} * (i % 2 == 0 ? 1.0f : 0.02f);
  if (i % 9 == 0) q.position = {0.25f, 0.0f, 0.25f};
  const float radius = i % 4 == 0 ? 0.01f : i % 4 == 1 ? 0.3f : i % 4 == 2 ? kInfinity : 0.05f;
  q.max_distance2 = radius * radius;
  q.nearest = i % 3 == 0 ? 1 : i % 3 == 1 ? 50 : 333;
  q.normal = i % 5 == 0 ? Vec3f{0, -1, 0} : i % 5 == 1 ? Vec3f{1, 0, 0} : normalize(Vec3f{0.1f, 1.0f, -0.2f});
  q.both_sides = i % 4 == 3;
  return q;
}

class PhotonMapOfSize : public testing::TestWithParam<int> {};

TEST_P(PhotonMapOfSize, FindsExactlyTheNearestThatBruteForceFinds) {
  const PhotonMap map = map_of(some_photons(GetParam()));
  ASSERT_EQ(map.size(), static_cast<std::size_t>(GetParam()));
  PathRng rng(5, Stream::kTest, 0, 1);
  NearestPhotons found;
  for (int i = 0; i < 300; ++i) {
    const NearestQuery q = some_query(rng, i);
    std::vector<float> all;
    for (std::uint32_t p = 1; p <= map.size(); ++p) {
      const float d = map.distance2(q, p);
      if (d < kInfinity) all.push_back(d);
    }
    std::sort(all.begin(), all.end());
    map.nearest(q, found);
    std::size_t expected = all.size();
    float radius2 = q.max_distance2;
    const std::size_t k = std::isinf(radius2) ? std::min<std::size_t>(q.nearest, all.size()) : q.nearest;
    if (k > 0 && all.size() >= k) {
      expected = k - 1;
      radius2 = all[expected];
    }
    ASSERT_EQ(found.count, expected) << i;
    ASSERT_EQ(found.radius2, radius2) << i;
    std::vector<float> distances(found.distance2.begin(),
                                 found.distance2.begin() + static_cast<std::ptrdiff_t>(expected));
    std::sort(distances.begin(), distances.end());
    all.resize(expected);
    ASSERT_EQ(distances, all) << i;
    std::vector<std::uint32_t> indices(found.index.begin(),
                                       found.index.begin() + static_cast<std::ptrdiff_t>(expected));
    for (std::size_t p = 0; p < expected; ++p) ASSERT_EQ(map.distance2(q, indices[p]), found.distance2[p]);
    std::sort(indices.begin(), indices.end());
    ASSERT_EQ(std::unique(indices.begin(), indices.end()), indices.end());
  }
}

TEST_P(PhotonMapOfSize, FindsTheNearestOne) {
  const PhotonMap map = map_of(some_photons(GetParam()));
  PathRng rng(6, Stream::kTest, 0, 1);
  for (int i = 0; i < 200; ++i) {
    const NearestQuery q = some_query(rng, i);
    float least = kInfinity;
    for (std::uint32_t p = 1; p <= map.size(); ++p) least = std::min(least, map.distance2(q, p));
    const std::uint32_t found = map.nearest_one(q);
    ASSERT_EQ(found != 0, least < kInfinity) << i;
    if (found != 0) {
      ASSERT_EQ(map.distance2(q, found), least) << i;
    }
  }
}

TEST_P(PhotonMapOfSize, AnswersAreTheSameBitsWhateverTheVectorCodeAndTheQueriesBefore) {
  if (PhotonTree::best_isa() != PhotonTree::Isa::kAvx512) GTEST_SKIP() << "one kind of vector code";
  const PhotonMap wide = map_of(some_photons(GetParam()));
  PhotonMap narrow = wide;
  narrow.use_isa(PhotonTree::Isa::kAvx2);
  PathRng rng(6, Stream::kTest, 0, 1);
  NearestPhotons after_others;
  for (int i = 0; i < 200; ++i) {
    const NearestQuery q = some_query(rng, i);
    NearestPhotons fresh;
    wide.nearest(q, fresh);
    narrow.nearest(q, after_others);
    ASSERT_EQ(fresh.count, after_others.count) << i;
    ASSERT_EQ(fresh.radius2, after_others.radius2) << i;
    for (std::size_t p = 0; p < fresh.count; ++p) {
      ASSERT_EQ(fresh.index[p], after_others.index[p]) << i;
      ASSERT_EQ(fresh.distance2[p], after_others.distance2[p]) << i;
    }
    ASSERT_EQ(wide.nearest_one(q), narrow.nearest_one(q)) << i;
  }
}

TEST_P(PhotonMapOfSize, IsLeftBalancedAndSortedByItsAxes) {
  const PhotonMap map = map_of(some_photons(GetParam()));
  // Every node that has a number up to size() exists: the levels are full from the left. Ancestors split by
  // their axis.
  for (std::uint32_t node = 2; node <= map.size(); ++node) {
    for (std::uint32_t child = node; child > 1; child /= 2) {
      const StoredPhoton& parent = map.photon(child / 2);
      const float at = map.photon(node).position[parent.axis()], split = parent.position[parent.axis()];
      ASSERT_TRUE(child % 2 == 0 ? at <= split : at >= split) << node << ' ' << child;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, PhotonMapOfSize,
                         testing::Values(0, 1, 2, 3, 7, 8, 14, 15, 16, 31, 64, 100, 1000, 4097, 9000));

TEST(PhotonMap, TakesTwentyBytesAPhoton) {
  const PhotonMap map = map_of(some_photons(1000));
  EXPECT_EQ(sizeof(StoredPhoton), 20u);
  EXPECT_EQ(map.bytes(), 1001u * 20u);
}

TEST(PhotonMap, HasTheSameBytesOnAnyNumberOfThreads) {
  const Photons photons = some_photons(50000);
  std::vector<StoredPhoton> first;
  for (const int threads : {1, 2, 5}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    const PhotonMap map = arena.execute([&] { return map_of(photons); });
    if (first.empty()) first.assign(map.photons().begin(), map.photons().end());
    ASSERT_EQ(first.size(), map.size());
    EXPECT_EQ(std::memcmp(first.data(), map.photons().data(), first.size() * sizeof(StoredPhoton)), 0) << threads;
  }
}

TEST(PhotonMap, KeepsEveryPhotonOfAllFlows) {
  const Photons a = some_photons(500), b = some_photons(123), none;
  const Photons* flows[] = {&a, &none, &b};
  const PhotonMap map{flows};
  ASSERT_EQ(map.size(), 623u);
  double sum = 0.0, expected = 0.0;
  for (const StoredPhoton& p : map.photons()) sum += static_cast<double>(p.position[0]);
  for (const Photons* flow : flows) {
    for (const Photon& photon : *flow) expected += static_cast<double>(photon.position.x);
  }
  EXPECT_NEAR(sum, expected, 1e-9);
}

TEST(PhotonMapRecord, DirectionsAndNormalsErrByLessThanTheirBound) {
  PathRng rng(8, Stream::kTest, 0, 0);
  float worst_direction = 0.0f, worst_normal = 0.0f;
  for (int i = 0; i < 200000; ++i) {
    const Vec3f d = sample_sphere(rng.next2());
    StoredPhoton p{};
    p.direction = static_cast<std::uint16_t>(pack_octahedral<kDirectionSteps, 8>(d));
    p.flags = static_cast<std::uint16_t>(pack_octahedral<kNormalMapSteps, 7>(d) << 2 | 3u);
    worst_direction = std::max(worst_direction, length(towards_light(p) - d));
    worst_normal = std::max(worst_normal, length(surface_normal(p) - d));
    ASSERT_EQ(p.axis(), 3u);
  }
  EXPECT_LT(worst_direction, kDirectionError);
  EXPECT_LT(worst_normal, kNormalError);
  EXPECT_GT(worst_direction, 0.5f * kDirectionError);  // the bounds are not idle
  EXPECT_GT(worst_normal, 0.5f * kNormalError);
}

TEST(PhotonMapRecord, NormalsAlongAnAxisAreExact) {
  for (const Vec3f& n : {Vec3f{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}) {
    const auto packed = pack_octahedral<kNormalMapSteps, 7>(n);
    EXPECT_LT(length(unpack_octahedral<kNormalMapSteps, 7>(packed) - n), 1e-4f);
  }
}

TEST(PhotonMapRecord, FluxErrsByLessThanAStepOfTheLargestChannel) {
  PathRng rng(9, Stream::kTest, 0, 0);
  for (int i = 0; i < 100000; ++i) {
    const Rgb flux = Rgb{rng.next1(), rng.next1(), rng.next1()} * std::exp2(60.0f * (rng.next1() - 0.5f));
    const Rgb kept = unpack_rgbe(pack_rgbe(flux, mix_bits(static_cast<std::uint32_t>(i))));
    for (int c = 0; c < 3; ++c) ASSERT_LE(std::abs(kept[c] - flux[c]), max_component(flux) / 128.0f);
  }
  EXPECT_TRUE(is_zero(unpack_rgbe(pack_rgbe({0, 0, 0}, 12345u))));
  EXPECT_EQ(unpack_rgbe(pack_rgbe({1, 0.5f, 0.25f}, 12345u)), Rgb(1, 0.5f, 0.25f));
}

TEST(PhotonMapRecord, TheMeanOfEqualFluxesIsExact) {
  for (const Rgb& flux : {Rgb{1.003f, 0.77f, 0.1f}, Rgb{0.9985f, 0.5f, 0.9982f}}) {
    std::array<std::vector<double>, 3> kept;
    for (std::uint32_t i = 0; i < 40000; ++i) {
      const Rgb one = unpack_rgbe(pack_rgbe(flux, mix_bits(i)));
      for (std::size_t c = 0; c < 3; ++c) kept[c].push_back(static_cast<double>(one[static_cast<int>(c)]));
    }
    for (std::size_t c = 0; c < 3; ++c) {
      const double expected = static_cast<double>(flux[static_cast<int>(c)]);
      EXPECT_TRUE(test::agrees(test::estimate(kept[c]), expected, 1e-5));
    }
  }
}

// 2 * integral of f(u) u du = 1 over the disc, of each filter; by f at squared distance u2: integral of f du2
// = 1.
TEST(MapFilter, EachIntegratesToOneOverTheDisc) {
  for (const PhotonFilter kind : {PhotonFilter::kDisc, PhotonFilter::kCone, PhotonFilter::kGaussian}) {
    const MapFilter filter(kind);
    constexpr int kSteps = 20000;
    double sum = 0.0;
    float before = filter.weight(0.0f);
    for (int i = 0; i < kSteps; ++i) {
      const float weight = filter.weight((static_cast<float>(i) + 0.5f) / kSteps);
      EXPECT_GE(weight, 0.0f);
      EXPECT_LE(weight, before + 1e-6f) << "not falling outwards";
      before = weight;
      sum += static_cast<double>(weight) / kSteps;
    }
    EXPECT_NEAR(sum, 1.0, 1e-5) << static_cast<int>(kind);
  }
}

// [Jensen 2001, (7.8) and (7.9)]: the shapes, against a formula written out anew.
TEST(MapFilter, HasThePapersShapes) {
  const MapFilter cone(PhotonFilter::kCone), gaussian(PhotonFilter::kGaussian);
  const auto pavicic = [](double u2) {
    return 0.918 * (1.0 - (1.0 - std::exp(-1.953 * u2 / 2.0)) / (1.0 - std::exp(-1.953)));
  };
  for (const double u2 : {0.0, 0.1, 0.37, 0.5, 0.81, 1.0}) {
    const double u = std::sqrt(u2);
    EXPECT_NEAR(static_cast<double>(cone.weight(static_cast<float>(u2)) / cone.weight(0.0f)), 1.0 - u / 1.1, 1e-6);
    EXPECT_NEAR(static_cast<double>(gaussian.weight(static_cast<float>(u2)) / gaussian.weight(0.0f)),
                pavicic(u2) / pavicic(0.0), 1e-6);
  }
}

TEST(MapFilter, IrradianceInLanesIsTheSumOneByOne) {
  const PhotonMap map = map_of(some_photons(3000));
  PathRng rng(12, Stream::kTest, 0, 1);
  NearestPhotons found;
  for (const PhotonFilter kind : {PhotonFilter::kDisc, PhotonFilter::kCone, PhotonFilter::kGaussian}) {
    const MapFilter filter(kind);
    for (int i = 0; i < 100; ++i) {
      NearestQuery q = some_query(rng, i);
      if (std::isinf(q.max_distance2)) q.max_distance2 = 0.04f;
      map.nearest(q, found);
      const Rgb lanes = filter.irradiance(map, found);
      const Rgb one_by_one = filter.scattered(map, found, [](const Vec3f&) { return Rgb{1, 1, 1}; });
      for (int c = 0; c < 3; ++c) ASSERT_NEAR(lanes[c], one_by_one[c], 1e-4f * (1.0f + one_by_one[c])) << i;
    }
  }
}

// Loftsgaarden and Quesenberry's k - 1, and the bound on the distance, leave the density without bias.
TEST(PhotonMap, DensityOfUniformPhotonsIsUnbiased) {
  constexpr int kPhotons = 500;
  for (const float expected_within : {4.0f, 20.0f, 200.0f}) {
    std::vector<double> densities;
    NearestPhotons found;
    for (std::uint32_t run = 0; run < 1500; ++run) {
      PathRng rng(11, Stream::kTest, 1, run);
      Photons photons;
      for (int i = 0; i < kPhotons; ++i) {
        const Vec2f p = rng.next2();
        photons.push_back(make_photon({p.x, 0, p.y}, {1, 1, 1}, {0, 1, 0}, {0, 1, 0}));
      }
      const PhotonMap map = map_of(photons);
      map.nearest({{0.5f, 0, 0.5f}, {0, 1, 0}, expected_within / (kPi * kPhotons), 20, false}, found);
      densities.push_back(static_cast<double>(found.count) / static_cast<double>(kPi * found.radius2));
    }
    EXPECT_TRUE(test::agrees(test::estimate(densities), kPhotons)) << expected_within;
  }
}

}  // namespace
}  // namespace pf
