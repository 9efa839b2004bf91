#include "jobs/benchmark/report.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <sstream>
#include <vector>

#include <gtest/gtest.h>

#include "jobs/benchmark/bench.h"
#include "jobs/benchmark/charts.h"
#include "jobs/benchmark/pictures.h"
#include "jobs/benchmark/results.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/jobs/benchmark/fake_runner.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

class BenchReport : public testing::Test {
 protected:
  void SetUp() override {
    write_suite(folder_);
    auto result = run_bench(
        {folder_ / "suite.toml", folder_ / "out", {}, "w", false, false}, runner_, [](const BenchProgress&) {}, notes_);
    ASSERT_TRUE(result) << result.error().message;
    result_ = std::move(*result);
    ASSERT_TRUE(write_pictures(result_, folder_ / "out" / "images"));
    charts_ = charts_of(result_, result_.scenes[0]);
    // Charts as gnuplot would leave them: what is in them is another test's.
    fs::create_directories(folder_ / "out" / "charts");
    for (const Chart& chart : charts_)
      std::ofstream(folder_ / "out" / "charts" / (chart.file + ".svg")) << "<svg>" << chart.file << "</svg>";
    std::ofstream(folder_ / "out" / "charts" / "overview.svg") << "<svg>overview</svg>";
  }
  [[nodiscard]] std::string html() const { return report_html(result_, folder_ / "out", notes_); }

  TempFolder temp_;
  const fs::path& folder_ = temp_.path();
  FakeRunner runner_;
  std::vector<std::string> notes_ = {"a note with <brackets>"};
  BenchResult result_;
  std::vector<Chart> charts_;
};

/// The first tag that is closed wrongly; empty when all is well.
std::string wrongly_nested(const std::string& html) {
  static const std::set<std::string> kVoid = {"meta", "img", "br", "input"};
  std::vector<std::string> open;
  const std::regex tag("<(/?)([a-z0-9]+)[^>]*>");
  for (std::sregex_iterator it(html.begin(), html.end(), tag), end; it != end; ++it) {
    std::string name = (*it)[2];
    if (kVoid.contains(name)) continue;
    if ((*it)[1].length() == 0) {
      open.push_back(name);
    } else if (open.empty() || open.back() != name) {
      return name;
    } else {
      open.pop_back();
    }
  }
  return open.empty() ? "" : open.back();
}

TEST_F(BenchReport, IsWellFormedAndNeedsNothingBesideItself) {
  // Pictures are long: the check of tags looks at what is around them.
  const std::string page = std::regex_replace(html(), std::regex("base64,[A-Za-z0-9+/=]*"), "base64,");
  EXPECT_EQ(wrongly_nested(page), "");
  EXPECT_NE(page.find("fake &lt;suite&gt;"), std::string::npos);
  EXPECT_NE(page.find("a note with &lt;brackets&gt;"), std::string::npos);
  EXPECT_FALSE(std::regex_search(page, std::regex("(src|href)=\"(?!data:|#)")));
  EXPECT_EQ(page.find("http"), std::string::npos);
  EXPECT_EQ(page.find("<script"), std::string::npos);
}

TEST_F(BenchReport, HoldsEveryChartAndEveryImage) {
  const std::string page = html();
  const fs::path out = folder_ / "out";
  EXPECT_GE(charts_.size(), 7u);  // error, trimmed and FLIP over time; memory, rays, photons; bias and variance
  for (const Chart& chart : charts_) {
    const std::string uri = data_uri(out / "charts" / (chart.file + ".svg"), "image/svg+xml");
    ASSERT_NE(uri, "");
    EXPECT_NE(page.find(uri), std::string::npos) << chart.file;
  }
  const SceneResult& scene = result_.scenes[0];
  std::vector<std::string> pictures = {reference_picture_name(scene)};
  for (std::size_t m = 0; m < 2; ++m) {
    pictures.push_back(picture_name(scene, m, false));
    pictures.push_back(picture_name(scene, m, true));
  }
  for (const std::string& name : pictures) {
    const std::string uri = data_uri(out / "images" / name, "image/png");
    ASSERT_NE(uri, "") << name;
    EXPECT_NE(page.find(uri), std::string::npos) << name;
  }
}

TEST_F(BenchReport, GnuplotDrawsEveryChart) {
  ASSERT_TRUE(fs::exists("/usr/bin/gnuplot")) << "deploy/install brings it";
  const fs::path folder = folder_ / "drawn";
  fs::create_directories(folder);
  const auto drawn = draw_charts("/usr/bin/gnuplot", charts_, {charts_[0]}, folder);
  ASSERT_TRUE(drawn) << drawn.error().message;
  std::vector<std::string> names = {"overview"};
  for (const Chart& chart : charts_) names.push_back(chart.file);
  for (const std::string& name : names) {
    EXPECT_GT(fs::file_size(folder / (name + ".png")), 1000u) << name;
    const std::string svg = bytes_of(folder / (name + ".svg"));
    EXPECT_NE(svg.find("</svg>"), std::string::npos) << name;
    EXPECT_NE(svg.find("sppm"), std::string::npos) << name;
  }
}

TEST_F(BenchReport, JudgesThePlannerWhereTheSuiteHasIt) {
  EXPECT_EQ(html().find("The planner ("), std::string::npos);
  EXPECT_TRUE(results_json(result_)["scenes"][0]["planner"].empty());
  result_.suite.methods[1].type = "auto";
  const std::string page = std::regex_replace(html(), std::regex("base64,[A-Za-z0-9+/=]*"), "base64,");
  EXPECT_NE(page.find("The planner (" + result_.suite.methods[1].name + ")"), std::string::npos);
  EXPECT_EQ(wrongly_nested(page), "");
  const auto planner = results_json(result_)["scenes"][0]["planner"];
  ASSERT_EQ(planner.size(), 1u);
  EXPECT_EQ(planner[0]["least"]["soonest"], result_.suite.methods[0].name);
  EXPECT_GT(planner[0]["least"]["ratio"].get<double>(), 0.0);
}

TEST_F(BenchReport, AFailureStandsInTheReport) {
  result_.scenes[0].methods[1].runs[0].error = "exited with code 5: no more \"paper\"";
  EXPECT_NE(html().find("no more &quot;paper&quot;"), std::string::npos);
  EXPECT_NE(results_csv(result_).find("\"exited with code 5: no more \"\"paper\"\"\""), std::string::npos);
}

TEST_F(BenchReport, TheTableOfResultsHasOneLineForEachImage) {
  const std::string csv = results_csv(result_);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 1 + 2 * 3 * 3);
  std::istringstream lines(csv);
  std::string line;
  std::getline(lines, line);
  const auto columns = std::count(line.begin(), line.end(), ',');
  while (std::getline(lines, line)) EXPECT_EQ(std::count(line.begin(), line.end(), ','), columns) << line;
  EXPECT_EQ(results_json(result_)["results_version"], kResultsVersion);
}

}  // namespace
}  // namespace pf::bench
