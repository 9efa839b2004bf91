#include "jobs/benchmark/ablation.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "jobs/benchmark/bench.h"
#include "jobs/benchmark/planner_report.h"
#include "jobs/benchmark/results.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/jobs/benchmark/fake_runner.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kAblated = "[[method]]\ntype = \"auto\"\nablate = true\n";

/// A plan that chose sppm: a term of its own and one of the materials that are on, and what cannot be turned round.
json plan() {
  json decisions = json::array();
  for (const auto& [subject, choice] : {std::pair{"algorithm", "sppm"},
                                        {"photons", "5000"},
                                        {"light samples", "4"},
                                        {"caustic map", "on"},
                                        {"guided emission", "on"},
                                        {"environment", "off"},
                                        {"textures", "off"},
                                        {"absorption", "on"}}) {
    decisions.push_back({{"subject", subject}, {"choice", choice}, {"reason", "so"}});
  }
  return {{"plan", {{"decisions", decisions}}}};
}

class BenchAblations : public testing::Test {
 protected:
  void SetUp() override {
    write_suite(folder_, kAblated);
    runner_.plan_document = plan();
    runner_.worse = "integrator.guide_emission=off";
  }
  Result<BenchResult> run() {
    request_.suite = folder_ / "suite.toml";
    request_.out = folder_ / "out";
    runner_.orders.clear();
    std::vector<std::string> notes;
    return run_bench(
        request_, runner_, [this](const BenchProgress& p) { progress_ = p; }, notes);
  }
  [[nodiscard]] bool has(const RenderOrder& order, const std::string& setting) const {
    return std::ranges::find(order.set, setting) != order.set.end();
  }
  TempFolder temp_;
  const fs::path& folder_ = temp_.path();
  BenchRequest request_{
      .suite = {}, .out = {}, .cache = {}, .worker = "build-1", .retry_failed = false, .report_only = false};
  FakeRunner runner_;
  BenchProgress progress_;
};

TEST_F(BenchAblations, TurnEachTermRoundAtThePassesOfTheMethod) {
  const auto result = run();
  ASSERT_TRUE(result) << result.error().message;
  const auto& found = result->scenes[0].ablations;
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].term, "guided emission");
  EXPECT_EQ(found[0].planned, "on");
  EXPECT_EQ(found[0].algorithm, "sppm");
  EXPECT_EQ(found[0].instead, "integrator.guide_emission=off");
  EXPECT_EQ(found[0].seeds, 3);
  EXPECT_NEAR(found[0].error_ratio, 4.0, 0.5);  // twice the noise
  EXPECT_LE(found[0].lowest_ratio, found[0].error_ratio);
  EXPECT_GE(found[0].highest_ratio, found[0].error_ratio);
  EXPECT_EQ(found[1].term, "absorption");
  EXPECT_DOUBLE_EQ(found[1].error_ratio, 1.0);
  EXPECT_DOUBLE_EQ(found[1].seconds_ratio, 1.0);
  int turned = 0;
  for (const RenderOrder& order : runner_.orders) {
    if (order.snapshot_passes != std::vector<std::int64_t>{20}) continue;  // the last budget but one of three
    ++turned;
    EXPECT_TRUE(has(order, "integrator.type=sppm"));
    EXPECT_TRUE(has(order, "integrator.photons=5000"));
    EXPECT_TRUE(has(order, "integrator.light_samples=4")) << "planned anew, they could be others";
    EXPECT_TRUE(has(order, "integrator.guide_emission=on"));
    EXPECT_FALSE(has(order, "photon_map.caustic_map=off"));
  }
  EXPECT_EQ(turned, 3 * 3);
  EXPECT_EQ(progress_.total, 3u * 3 + 3 * 3);
}

TEST_F(BenchAblations, AreMadeOnce) {
  const auto first = run();
  ASSERT_TRUE(first);
  runner_.plan_document = json();
  const auto again = run();
  ASSERT_TRUE(again);
  EXPECT_TRUE(runner_.orders.empty());
  EXPECT_EQ(results_json(*again)["scenes"], results_json(*first)["scenes"]);
}

TEST_F(BenchAblations, OfASceneThatCannotBePlannedAreNone) {
  runner_.plan_document = json();
  const auto result = run();
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_TRUE(result->scenes[0].ablations.empty());
  EXPECT_EQ(ablations_html(*result), "");
}

TEST_F(BenchAblations, StandInTheReportWithWhatFailed) {
  runner_.broken = "sppm";
  const auto failed = run();
  ASSERT_TRUE(failed);
  EXPECT_EQ(failed->scenes[0].ablations[0].seeds, 0);
  EXPECT_NE(ablations_html(*failed).find("no error to judge"), std::string::npos);
  EXPECT_TRUE(results_json(*failed)["scenes"][0]["ablations"][0]["error_ratio"].is_null());
  runner_.broken.clear();
  request_.worker = "build-2";
  const auto result = run();
  ASSERT_TRUE(result);
  const std::string html = ablations_html(*result);
  EXPECT_NE(html.find("<td>guided emission</td><td>on</td>"), std::string::npos);
  EXPECT_NE(html.find("Of 2 terms that the plans have put in"), std::string::npos);
  EXPECT_NE(html.find("No term that the plans have left out"), std::string::npos);
  const auto ablation = results_json(*result)["scenes"][0]["ablations"][0];
  EXPECT_EQ(ablation["algorithm"], "sppm");
  EXPECT_NEAR(ablation["error_ratio"].get<double>(), 4.0, 0.5);
}

}  // namespace
}  // namespace pf::bench
