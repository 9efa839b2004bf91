#include "worker/photon/emission_guide.h"

#include <array>
#include <memory>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

#include "common/math/philox.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"
#include "worker/photon/photon_tracer.h"

namespace pf {
namespace {

EmissionGuide::Numbers uniform_numbers(PathRng& rng) {
  EmissionGuide::Numbers u;
  for (float& number : u) number = rng.next1();
  return u;
}

/// Paths matter whose second number is below 0.1 and whose last is above 0.75.
double corner(const EmissionGuide::Numbers& u) { return u[1] < 0.1f && u[4] > 0.75f ? 1.0 : 0.0; }

template <typename Worth>
EmissionGuide taught(Worth&& worth, std::uint32_t examples = 20000) {
  std::vector<EmissionGuide::Example> all;
  for (std::uint32_t i = 0; i < examples; ++i) {
    PathRng rng(1, Stream::kTest, 0, i);
    const EmissionGuide::Numbers u = uniform_numbers(rng);
    all.push_back({u, 1.0, worth(u)});
  }
  return EmissionGuide(std::move(all));
}

TEST(EmissionGuide, IsUniformWhereNothingWasLearned) {
  for (const EmissionGuide& guide : {EmissionGuide(), EmissionGuide(std::vector<EmissionGuide::Example>()),
                                     taught([](const auto&) { return 0.0; })}) {
    EXPECT_TRUE(guide.uniform());
    const EmissionGuide::Numbers u{0.1f, 0.2f, 0.3f, 0.4f, 0.5f};
    EXPECT_EQ(guide.draw(u).u, u);
    EXPECT_EQ(guide.draw(u).weight, 1.0f);
  }
}

TEST(EmissionGuide, DrawsWhereExamplesWereWorthMuch) {
  const EmissionGuide guide = taught(corner);
  constexpr std::uint32_t kDraws = 100000;
  double inside = 0;
  for (std::uint32_t i = 0; i < kDraws; ++i) {
    PathRng rng(2, Stream::kTest, 0, i);
    inside += corner(guide.draw(uniform_numbers(rng)).u);
  }
  EXPECT_GT(inside / kDraws, 0.5) << "a fortieth of the volume";
}

// Whatever it learned: the mean of any function, by weight, is its integral.
TEST(EmissionGuide, KeepsEveryMean) {
  const EmissionGuide guide = taught(corner);
  ASSERT_GT(guide.cells(), 10u);
  const std::array<double, 4> expected{1.0, 0.1 * 0.25, 2.5, 0.25 - 0.25 * 0.5 * 0.01};
  std::array<std::vector<double>, expected.size()> values;
  for (std::uint32_t i = 0; i < 400000; ++i) {
    PathRng rng(3, Stream::kTest, 0, i);
    const EmissionGuide::Drawn drawn = guide.draw(uniform_numbers(rng));
    for (const float number : drawn.u) ASSERT_TRUE(number >= 0.0f && number < 1.0f);
    const double weight = double{drawn.weight};
    ASSERT_LE(weight, 1.0 / EmissionGuide::kUniformShare + 1e-3);
    const double sum = std::accumulate(drawn.u.begin(), drawn.u.end(), 0.0);
    values[0].push_back(weight);
    values[1].push_back(weight * corner(drawn.u));
    values[2].push_back(weight * sum);
    values[3].push_back(weight * (1.0 - corner(drawn.u)) * double{drawn.u[0]} * double{drawn.u[1]});
  }
  std::vector<test::Estimate> means;
  for (const std::vector<double>& of_function : values) means.push_back(test::estimate(of_function));
  EXPECT_TRUE(test::all_agree(means, expected));
}

// The halves of one number alone tell nothing: only both together do.
TEST(EmissionGuide, LearnsFromItsOwnDraws) {
  const auto worth = [](const EmissionGuide::Numbers& u) { return (u[0] < 0.02f && u[3] < 0.02f) ? 1.0 : 0.0; };
  std::vector<EmissionGuide::Example> all;
  EmissionGuide guide;
  double inside = 0;
  for (std::uint64_t lesson = 0; lesson < 4; ++lesson) {
    inside = 0;
    for (std::uint32_t i = 0; i < 20000; ++i) {
      PathRng rng(4, Stream::kTest, lesson, i);
      const EmissionGuide::Drawn drawn = guide.draw(uniform_numbers(rng));
      all.push_back({drawn.u, double{drawn.weight}, worth(drawn.u)});
      inside += worth(drawn.u) / 20000;
    }
    guide = EmissionGuide(all);
  }
  EXPECT_GT(inside, 0.1) << "0.0004 of the volume";
}

TEST(EmissionGuide, BringsPhotonsOfTheSameFluxEverywhere) {
  const auto scene = test::peer_box(16).build();
  // An arbitrary guide: what it favours does not matter to the mean.
  const EmissionGuide guide =
      taught([](const EmissionGuide::Numbers& u) { return double{u[1]} * double{u[1]} + (u[3] > 0.6f ? 3.0 : 0.0); });
  ASSERT_GT(guide.cells(), 10u);
  PhotonOptions options{7, 20000, 0};
  const PhotonTracer plain(*scene, options);
  options.guide = &guide;
  const PhotonTracer guided(*scene, options);
  constexpr std::size_t kFigures = 7;  // flux stored: all of each flow, x of both sides of the room, and moments
  std::array<std::array<std::vector<double>, kFigures>, 2> figures;  // by tracer
  for (std::uint64_t pass = 0; pass < 40; ++pass) {
    for (std::size_t which = 0; which < 2; ++which) {
      const PhotonBatch batch = (which == 0 ? plain : guided).trace(pass);
      std::array<double, kFigures> sums{};
      for (std::size_t flow = 0; flow < kFlows; ++flow) {
        for (const Photon& photon : batch.flows[flow]) {
          const double flux = double{luminance(photon.flux)} / options.paths;
          sums[flow] += flux;
          sums[2 + (photon.position.x < 0.0f ? 0 : 1)] += flux;
          sums[4] += flux * double{photon.position.y};
          sums[5] += flux * double{photon.position.z};
          sums[6] += flux * double{photon.position.z} * double{photon.position.y};
        }
      }
      for (std::size_t k = 0; k < kFigures; ++k) figures[which][k].push_back(sums[k]);
    }
  }
  std::array<std::vector<test::Estimate>, 2> means;
  for (std::size_t which = 0; which < 2; ++which) {
    for (const std::vector<double>& values : figures[which]) means[which].push_back(test::estimate(values));
  }
  EXPECT_TRUE(test::all_agree(means[1], means[0]));
}

}  // namespace
}  // namespace pf
