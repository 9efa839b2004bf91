#include "jobs/benchmark/bench.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

#include <gtest/gtest.h>

#include "common/film/flip.h"
#include "common/film/metrics.h"
#include "jobs/benchmark/results.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/jobs/benchmark/fake_runner.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

class Bench : public testing::Test {
 protected:
  Result<BenchResult> run(const std::string& out = "out") {
    request_.suite = folder_ / "suite.toml";
    request_.out = folder_ / out;
    runner_.rendered.clear();
    return run_bench(
        request_, runner_, [this](const BenchProgress& p) { progress_.push_back(p); }, notes_);
  }
  /// How many renders were no reference halves.
  [[nodiscard]] long runs() const {
    return std::ranges::count_if(runner_.rendered,
                                 [](const std::string& r) { return r.find("400000000") == std::string::npos; });
  }
  TempFolder temp_;
  const fs::path& folder_ = temp_.path();
  BenchRequest request_{
      .suite = {}, .out = {}, .cache = {}, .worker = "build-1", .retry_failed = false, .report_only = false};
  FakeRunner runner_;
  std::vector<std::string> notes_;
  std::vector<BenchProgress> progress_;
};

TEST_F(Bench, MeasuresEveryBudgetOfEveryRun) {
  write_suite(folder_);
  const auto result = run();
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(runs(), 6);
  const SceneResult& scene = result->scenes.at(0);
  ASSERT_EQ(scene.methods.size(), 2u);
  for (const MethodResult& method : scene.methods) {
    ASSERT_EQ(method.runs.size(), 3u);
    ASSERT_EQ(method.groups.size(), 3u);
    EXPECT_EQ(method.groups[0].runs, 3);
    EXPECT_DOUBLE_EQ(method.groups[1].seconds, 2.0);
    EXPECT_NEAR(method.groups[0].rel_mse, 0.01 / 0.26, 0.012);
    EXPECT_NEAR(method.groups[2].rel_mse, 0.0025 / 0.26, 0.003);
    ASSERT_TRUE(method.slope);
    EXPECT_NEAR(method.slope->line.slope, -1.0, 0.05);  // noise over the root of time
    EXPECT_NEAR(method.groups[2].relative->variance, 0.0025 / 0.26, 0.003);
    EXPECT_NEAR(method.groups[2].relative->bias2, 0.0, 0.0015);
  }
  // One sample as the metrics of common/film have it.
  const Sample& sample = scene.methods[0].runs[0].samples[0];
  const auto image = read_beauty(sample.exr);
  ASSERT_TRUE(image);
  EXPECT_DOUBLE_EQ(sample.rel_mse, compare_pixels(image->pixels, scene.reference.mean).relative_mse);
  EXPECT_DOUBLE_EQ(sample.hdr_flip, hdr_flip(image->pixels, scene.reference.mean, 12, 8).mean);
  EXPECT_DOUBLE_EQ(sample.rel_mse_corrected, sample.rel_mse - scene.reference.noise);
  EXPECT_FALSE(scene.front.empty());
  EXPECT_EQ(progress_.back().total, 6u);
  EXPECT_GE(progress_.back().left, 0.0);
}

TEST_F(Bench, GoesOnAfterAKillToTheSameResult) {
  write_suite(folder_);
  const auto whole = run("whole");
  ASSERT_TRUE(whole);
  for (int calls = 0; calls < 8; ++calls) {  // each time one render more, then it is cut off in the middle of the next
    runner_.interrupt_after = 1;
    const auto cut = run("cut");
    if (cut) break;
    EXPECT_EQ(cut.error().kind, ErrorKind::kInterrupted);
    EXPECT_EQ(runner_.rendered.size(), 1u);
  }
  runner_.interrupt_after = -1;
  const auto result = run("cut");
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_TRUE(runner_.rendered.empty());
  auto expected = results_json(*whole), got = results_json(*result);
  for (auto* document : {&expected, &got}) {
    document->erase("machine");
    for (auto& r : (*document)["runs"]) r.erase("load_average");
    (*document)["scenes"][0]["reference"].erase("seconds");
  }
  EXPECT_EQ(got, expected);
}

TEST_F(Bench, AChangedSuiteMakesOnlyWhatChanged) {
  write_suite(folder_);
  ASSERT_TRUE(run());
  write_suite(folder_, "[[method]]\ntype = \"ppm\"\n");
  ASSERT_TRUE(run());
  EXPECT_EQ(runner_.rendered.size(), 3u);
  EXPECT_TRUE(runner_.rendered[0].starts_with("ppm "));
  write_suite(folder_, "", "2000");
  ASSERT_TRUE(run());
  EXPECT_EQ(runner_.rendered.size(), 3u);
  EXPECT_TRUE(runner_.rendered[0].starts_with("sppm "));
  request_.worker = "build-2";  // the figures of one build are no figures of another; references stay
  ASSERT_TRUE(run());
  EXPECT_EQ(runner_.rendered.size(), 6u);
  std::ofstream(folder_ / "empty.gltf") << R"({"asset":{"version":"2.0"},"extras":1})";
  ASSERT_TRUE(run());
  EXPECT_EQ(runner_.rendered.size(), 8u);  // another scene: reference and runs
}

TEST_F(Bench, AFailedRunIsARowAndNotTheEnd) {
  write_suite(folder_);
  runner_.fails = "sppm";
  const auto result = run();
  ASSERT_TRUE(result);
  EXPECT_EQ(result->scenes[0].methods[0].groups.size(), 3u);
  EXPECT_TRUE(result->scenes[0].methods[1].groups.empty());
  EXPECT_NE(results_csv(*result).find("exited with code 5: it broke"), std::string::npos);
  runner_.fails.clear();
  ASSERT_TRUE(run());
  EXPECT_EQ(runs(), 0);  // finished is finished
  request_.retry_failed = true;
  const auto again = run();
  ASSERT_TRUE(again);
  EXPECT_EQ(runs(), 3);
  EXPECT_EQ(again->scenes[0].methods[1].groups.size(), 3u);
}

TEST_F(Bench, AFailedReferenceLeavesRunsWithoutErrors) {
  write_suite(folder_);
  runner_.fails = "path";  // the reference's method
  const auto result = run();
  ASSERT_TRUE(result);
  EXPECT_NE(result->scenes[0].reference.error, "");
  EXPECT_EQ(result->scenes[0].methods[1].runs.size(), 3u);
  EXPECT_TRUE(result->scenes[0].methods[1].groups.empty());
}

TEST_F(Bench, PixelsThatAreNoNumbersAreCounted) {
  write_suite(folder_);
  runner_.broken = "sppm";
  const auto result = run();
  ASSERT_TRUE(result);
  const Sample& sample = result->scenes[0].methods[1].runs[0].samples[0];
  EXPECT_EQ(sample.nonfinite_pixels, 1u);
  EXPECT_EQ(sample.negative_pixels, 1u);
  EXPECT_TRUE(std::isnan(sample.rel_mse));
  EXPECT_EQ(results_json(*result)["runs"][3]["samples"][0]["nonfinite_pixels"], 1);
}

TEST_F(Bench, RunsOfARepetitionAreShuffledBetweenMethods) {
  write_suite(folder_,
              "[[method]]\ntype = \"ppm\"\n[[method]]\ntype = \"photon_map\"\n[[method]]\ntype = \"photon_splat\"\n");
  const auto result = run();
  ASSERT_TRUE(result);
  std::vector<std::vector<std::size_t>> orders;
  for (std::size_t i = 0; i < result->schedule.size(); ++i) {
    const bench::Run& r = result->schedule[i];
    EXPECT_EQ(r.repetition, static_cast<int>(i / 5));
    if (i % 5 == 0) orders.emplace_back();
    orders.back().push_back(r.method);
  }
  for (const auto& order : orders) EXPECT_EQ(std::set<std::size_t>(order.begin(), order.end()).size(), 5u);
  EXPECT_TRUE(orders[0] != orders[1] || orders[1] != orders[2]);
  const auto again = run();
  ASSERT_TRUE(again);
  for (std::size_t i = 0; i < result->schedule.size(); ++i) EXPECT_EQ(again->schedule[i].id, result->schedule[i].id);
}

TEST_F(Bench, AReferenceIsRenderedUntilItIsGoodEnough) {
  write_suite(folder_);
  const auto first = run();
  ASSERT_TRUE(first);
  const Reference& reference = first->scenes[0].reference;
  EXPECT_EQ(reference.passes, 4u);
  EXPECT_NEAR(reference.noise, 0.01 / 400 / 2 / 0.26, 1e-5);  // two halves of variance 0.01/400
  std::string text = bytes_of(folder_ / "suite.toml");
  text.replace(text.find("passes = 4"), 10, "passes = 4\nmax_passes = 64\nconfidence = 1.8e-5");
  std::ofstream(folder_ / "suite.toml") << text;
  const auto second = run();
  ASSERT_TRUE(second);
  EXPECT_EQ(runs(), 0);
  EXPECT_EQ(second->scenes[0].reference.passes, 16u);  // noise 4.8e-5 at 4, 1.2e-5 at 16
  EXPECT_NE(second->scenes[0].reference.key(), reference.key());
}

TEST_F(Bench, AFolderInUseIsRefused) {
  write_suite(folder_);
  ASSERT_TRUE(run());
  struct Nested final : Runner {
    BenchRequest request;
    Result<BenchResult> inner = fail(ErrorKind::kInternal, "not run");
    Result<nlohmann::json> plan(const fs::path&, const std::vector<std::string>&) override {
      return fail(ErrorKind::kInternal, "no plan is asked for");
    }
    Result<RenderOutcome> render(const RenderOrder&, const std::function<void(double)>&) override {
      FakeRunner fake;
      std::vector<std::string> notes;
      inner = run_bench(
          request, fake, [](const BenchProgress&) {}, notes);
      return fail(ErrorKind::kInterrupted, "");
    }
  } nested;
  request_.worker = "another";
  nested.request = request_;
  EXPECT_FALSE(run_bench(
      request_, nested, [](const BenchProgress&) {}, notes_));
  ASSERT_FALSE(nested.inner);
  EXPECT_EQ(nested.inner.error().kind, ErrorKind::kUsage);
}

}  // namespace
}  // namespace pf::bench
