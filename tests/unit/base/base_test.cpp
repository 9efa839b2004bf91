#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <sys/resource.h>

#include <array>
#include <regex>
#include <sstream>
#include <vector>

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/base/nearest_name.h"
#include "common/base/result.h"
#include "common/base/uri.h"

namespace pf {
namespace {

constexpr std::array<std::string_view, 8> kNames = {"auto",         "path",         "photon_map", "final_gather",
                                                    "photon_splat", "round_growth", "ppm",        "sppm"};

TEST(NearestName, FindsWhatWasMeant) {
  EXPECT_EQ(nearest_name("photonmap", kNames), "photon_map");
  EXPECT_EQ(nearest_name("Photon-Map", kNames), "photon_map");
  EXPECT_EQ(nearest_name("ppth", kNames), "path");
  EXPECT_EQ(nearest_name("atuo", kNames), "auto");
  EXPECT_EQ(nearest_name("finalgahter", kNames), "final_gather");
  EXPECT_EQ(nearest_name("spm", kNames), "ppm");
}

TEST(NearestName, StaysSilentWhenNothingIsNear) {
  EXPECT_EQ(nearest_name("", kNames), std::nullopt);
  EXPECT_EQ(nearest_name("metropolis", kNames), std::nullopt);
  EXPECT_EQ(nearest_name(std::string(100'000, 'p'), kNames), std::nullopt);
  EXPECT_EQ(nearest_name("path", std::span<const std::string_view>{}), std::nullopt);
}

TEST(NearestName, TakesOwnedNamesToo) {
  const std::vector<std::string> cameras = {"Front", "Back"};
  EXPECT_EQ(nearest_name("front", cameras), "Front");
}

TEST(Log, WritesOneLineForAnEvent) {
  std::ostringstream out;
  const Log log(LogLevel::kInfo, std::make_shared<spdlog::sinks::ostream_sink_mt>(out));
  log.debug("not shown");
  log.info("unit done", {{"job", "glass"}, {"round", 3}, {"worker", "host a"}, {"seconds", 0.5}});
  const std::regex line(
      R"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z info unit done job=glass round=3 worker="host a" seconds=0.5\n)");
  EXPECT_TRUE(std::regex_match(out.str(), line)) << out.str();
}

TEST(Log, EscapesWhatWouldBreakALine) {
  EXPECT_EQ(format_log_line("failed", {{"why", "a\nb \"c\" \x1b[0m\\"}, {"empty", ""}, {"sum", "1=1"}}),
            R"(failed why="a\nb \"c\" \x1b[0m\\" empty="" sum="1=1")");
  EXPECT_EQ(format_log_line("two\nlines", {}), R"(two\nlines)");
}

TEST(Log, NamesItsLevels) {
  std::ostringstream out;
  const Log log(LogLevel::kWarning, std::make_shared<spdlog::sinks::ostream_sink_mt>(out));
  log.info("no");
  log.warning("late");
  log.error("lost");
  EXPECT_NE(out.str().find(" warning late\n"), std::string::npos) << out.str();
  EXPECT_NE(out.str().find(" error lost\n"), std::string::npos) << out.str();
  EXPECT_EQ(out.str().find(" no\n"), std::string::npos) << out.str();
}

TEST(Clock, FakeTimeMovesOnlyWhenTold) {
  FakeClock fake(10.0);
  const Clock& clock = fake;
  EXPECT_EQ(clock.now(), 10.0);
  fake.advance(2.5);
  EXPECT_EQ(clock.now(), 12.5);
}

TEST(Clock, SystemTimeNeverRunsBackwards) {
  const SystemClock clock;
  const double before = clock.now();
  EXPECT_GE(clock.now(), before);
}

TEST(Memory, PeakCountsWhatWasHeld) {
  const auto before = peak_resident_bytes();
  constexpr std::size_t kBytes = 64u << 20;
  const std::vector<char> held(kBytes, 1);
  EXPECT_EQ(held[kBytes / 2], 1);
  EXPECT_GE(peak_resident_bytes(), resident_bytes());
  EXPECT_GE(peak_resident_bytes(), before);
  EXPECT_GT(resident_bytes(), kBytes);
}

TEST(Memory, ThatIsKeptIsUsedAgainWithoutAskingTheSystem) {
  keep_freed_memory();
  constexpr std::size_t kBytes = 16u << 20, kPages = kBytes / 4096;
  const auto faults_of_use = [] {
    rusage before{}, after{};
    getrusage(RUSAGE_SELF, &before);
    const std::vector<char> used(kBytes, 1);
    getrusage(RUSAGE_SELF, &after);
    EXPECT_EQ(used[kBytes / 2], 1);
    return static_cast<std::size_t>(after.ru_minflt - before.ru_minflt);
  };
  (void)faults_of_use();
  EXPECT_LT(faults_of_use(), kPages / 100);
}

TEST(ExitCode, FollowsTheCommandLineContract) {
  EXPECT_EQ(exit_code(ErrorKind::kUsage), 2);
  EXPECT_EQ(exit_code(ErrorKind::kInvalidSpec), 2);
  EXPECT_EQ(exit_code(ErrorKind::kInvalidInput), 3);
  EXPECT_EQ(exit_code(ErrorKind::kUnavailable), 4);
  EXPECT_EQ(exit_code(ErrorKind::kTimeout), 4);
  EXPECT_EQ(exit_code(ErrorKind::kInternal), 5);
  EXPECT_EQ(exit_code(ErrorKind::kInterrupted), 130);
}

TEST(Uri, DecodesWhatIsEncodedAndLeavesALonePercentSign) {
  EXPECT_EQ(percent_decoded("a%20b%2Fc%2f"), "a b/c/");
  EXPECT_EQ(percent_decoded("100%"), "100%");
  EXPECT_EQ(percent_decoded("%2"), "%2");
  EXPECT_EQ(percent_decoded("%zz%41"), "%zzA");
}

TEST(Uri, KnowsAScheme) {
  EXPECT_TRUE(has_scheme("https://host/file"));
  EXPECT_TRUE(has_scheme("data:,x"));
  EXPECT_FALSE(has_scheme("textures/a:b.png"));
  EXPECT_FALSE(has_scheme(":x"));
  EXPECT_FALSE(has_scheme("a.png"));
  EXPECT_FALSE(has_scheme(""));
}

}  // namespace
}  // namespace pf
