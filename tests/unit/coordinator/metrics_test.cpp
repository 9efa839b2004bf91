#include "coordinator/metrics.h"

#include <filesystem>
#include <regex>
#include <set>
#include <sstream>

#include <gtest/gtest.h>

#include "common/base/atomic_file.h"
#include "tests/support/paths.h"

namespace pf::test {
namespace {

/// Names of the metrics in a text, as a query writes them.
std::set<std::string> names_in(const std::string& text) {
  static const std::regex kName("photonfarm_[a-z_]+");
  std::set<std::string> names;
  for (std::sregex_iterator it(text.begin(), text.end(), kName), end; it != end; ++it) names.insert(it->str());
  return names;
}

std::string some_text() {
  Metrics metrics;
  metrics.rays += 5;
  metrics.unit_seconds.observe(0.3);
  metrics.unit_seconds.observe(1000);
  metrics.request("GET", "/v1/jobs/{}", 200, 0.002);
  metrics.request("GET", "/v1/jobs/{}", 404, 0.2);
  JobView job;
  job.state = JobState::kRunning;
  job.rays_per_second = 2e6;
  WorkerView worker;
  worker.state = "tracing";
  worker.units_held = 3;
  return metrics.text({job, job}, {worker});
}

TEST(Metrics, SayWhatWasCounted) {
  const std::string text = some_text();
  for (const char* line :
       {"photonfarm_rays_total 5\n", "photonfarm_jobs{state=\"running\"} 2\n", "photonfarm_jobs{state=\"failed\"} 0\n",
        "photonfarm_workers{state=\"tracing\"} 1\n", "photonfarm_units_held 3\n",
        "photonfarm_rays_per_second 4000000\n", "photonfarm_unit_seconds_bucket{le=\"0.25\"} 0\n",
        "photonfarm_unit_seconds_bucket{le=\"0.5\"} 1\n", "photonfarm_unit_seconds_bucket{le=\"600\"} 1\n",
        "photonfarm_unit_seconds_bucket{le=\"+Inf\"} 2\n", "photonfarm_unit_seconds_count 2\n",
        "photonfarm_unit_seconds_sum 1000.3\n",
        "photonfarm_http_request_seconds_bucket{method=\"GET\",route=\"/v1/jobs/{}\",le=\"0.0025\"} 1\n",
        "photonfarm_http_request_seconds_count{method=\"GET\",route=\"/v1/jobs/{}\"} 2\n",
        "photonfarm_http_requests_total{method=\"GET\",route=\"/v1/jobs/{}\",code=\"404\"} 1\n"}) {
    EXPECT_NE(text.find(line), std::string::npos) << line << text;
  }
}

TEST(Metrics, EveryLineIsOfTheFormatAndEveryMetricIsDescribedOnce) {
  static const std::regex kSample(R"(photonfarm_[a-z_]+(\{([a-z_]+="[^"]*")(,[a-z_]+="[^"]*")*\})? [0-9.e+-]+)");
  static const std::regex kComment(R"(# (HELP|TYPE) photonfarm_[a-z_]+ .+)");
  std::istringstream lines(some_text());
  std::set<std::string> comments;
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("#")) {
      EXPECT_TRUE(std::regex_match(line, kSample)) << line;
      continue;
    }
    EXPECT_TRUE(std::regex_match(line, kComment)) << line;
    EXPECT_TRUE(comments.insert(line.substr(0, line.find(' ', 8))).second) << line;
  }
}

TEST(Metrics, DashboardAndAlertsNameOnlyWhatThereIs) {
  const std::set<std::string> known = names_in(some_text());
  const std::filesystem::path folder = test::source_dir() / "deploy" / "prometheus";
  std::set<std::string> shown;
  for (const char* file : {"grafana-dashboard.json", "photonfarm.rules.yml"}) {
    const auto text = read_file(folder / file, 1 << 20);
    ASSERT_TRUE(text);
    for (const std::string& name : names_in(*text)) {
      EXPECT_TRUE(known.contains(name)) << file << " names " << name;
      shown.insert(name);
    }
  }
  EXPECT_GT(shown.size(), 15U);
}

}  // namespace
}  // namespace pf::test
