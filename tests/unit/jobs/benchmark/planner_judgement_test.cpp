#include "jobs/benchmark/planner_judgement.h"

#include <cmath>

#include <gtest/gtest.h>

namespace pf::bench {
namespace {

MethodResult method_of(const std::vector<Point>& curve) {
  MethodResult method;
  for (const Point& point : curve) {
    Group g;
    g.seconds = point.x;
    g.rel_mse_corrected = point.y;
    method.groups.push_back(g);
  }
  return method;
}

/// One scene, targets 0.1, 0.01 and 0.001, methods of these types and curves.
BenchResult bench_of(const std::vector<std::pair<std::string, std::vector<Point>>>& methods) {
  BenchResult bench;
  bench.suite.time = TimeAxis::kWall;
  SceneResult scene;
  for (const auto& [type, curve] : methods) {
    MethodEntry entry;
    entry.type = entry.name = type;
    bench.suite.methods.push_back(entry);
    scene.methods.push_back(method_of(curve));
  }
  bench.scenes.push_back(scene);
  return bench;
}

TEST(PlannerJudgement, DividesByTheSoonestOtherMethod) {
  const BenchResult bench = bench_of({{"auto", {{1, 0.2}, {4, 0.0125}, {8, 0.003125}}},
                                      {"path", {{1, 0.4}, {16, 0.025}}},
                                      {"sppm", {{1, 0.1}, {2, 0.025}, {4, 0.00625}, {8, 0.0015625}}}});
  const PlannerOfScene found = judge_planner(bench, bench.scenes[0], 0);
  ASSERT_EQ(found.targets.size(), 3u);
  // Errors fall with the square of time: sqrt(2) times the time for twice the error.
  ASSERT_TRUE(found.targets[0] && found.targets[1]);
  EXPECT_NEAR(found.targets[0]->ratio, std::sqrt(2.0), 1e-9);
  EXPECT_NEAR(found.targets[1]->ratio, std::sqrt(2.0), 1e-9);
  EXPECT_EQ(found.targets[0]->kind, TimeRatio::Kind::kExact);
  EXPECT_EQ(found.targets[0]->soonest, 2u);
  EXPECT_FALSE(found.targets[2]) << "nobody gets to 0.001";
  EXPECT_EQ(found.least_error, 0.0015625);
  ASSERT_TRUE(found.least);
  EXPECT_EQ(found.least->kind, TimeRatio::Kind::kAtLeast);
  EXPECT_NEAR(found.least->ratio, 1.0, 1e-9);
}

TEST(PlannerJudgement, TellsWhereTheFirstImageIsGoodEnough) {
  const BenchResult bench = bench_of({{"auto", {{2, 0.05}}}, {"sppm", {{1, 0.2}, {4, 0.0125}}}});
  const PlannerOfScene found = judge_planner(bench, bench.scenes[0], 0);
  ASSERT_TRUE(found.targets[0]);
  EXPECT_EQ(found.targets[0]->kind, TimeRatio::Kind::kAtMost);
  EXPECT_NEAR(found.targets[0]->ratio, std::sqrt(2.0), 1e-9);
}

TEST(PlannerJudgement, TakesNothingBelowTheReferencesNoiseForAnError) {
  BenchResult bench = bench_of({{"auto", {{1, 0.004}, {2, 0.001}}}, {"sppm", {{1, 0.001}, {2, -0.0001}}}});
  bench.scenes[0].reference.noise = 0.001;
  const PlannerOfScene found = judge_planner(bench, bench.scenes[0], 0);
  EXPECT_EQ(found.least_error, 0.001);
  ASSERT_TRUE(found.least);
  EXPECT_NEAR(found.least->ratio, 2.0, 1e-9);
}

TEST(PlannerJudgement, SaysNothingWithoutARival) {
  const BenchResult bench = bench_of({{"auto", {{1, 0.01}}}, {"auto", {{1, 0.02}}}, {"sppm", {}}});
  const PlannerOfScene found = judge_planner(bench, bench.scenes[0], 0);
  for (const auto& ratio : found.targets) EXPECT_FALSE(ratio);
  EXPECT_FALSE(found.least);
}

TEST(PlannerJudgement, SumsUpByMedianAndWorst) {
  const auto ratio = [](double value) { return std::optional(TimeRatio{TimeRatio::Kind::kExact, value, 0}); };
  const std::vector<std::optional<TimeRatio>> ratios{ratio(3), std::nullopt, ratio(1), ratio(2), ratio(1.5)};
  const RatioSummary all = summary_of(ratios);
  EXPECT_EQ(all.scenes, 4u);
  EXPECT_EQ(all.median, 1.75);
  EXPECT_EQ(all.worst, 3.0);
  EXPECT_EQ(summary_of({}).scenes, 0u);
}

}  // namespace
}  // namespace pf::bench
