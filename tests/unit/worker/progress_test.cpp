#include "worker/progress.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

namespace pf {
namespace {

using Style = ProgressReporter::Style;

Progress at(std::int64_t done, std::int64_t total, std::uint64_t rays = 0, std::uint64_t photons = 0) {
  Progress p;
  p.passes_done = done;
  p.passes_total = total;
  p.rays = rays;
  p.photons = photons;
  return p;
}

std::size_t lines(const std::string& text) {
  return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

TEST(Progress, SaysPercentPassesTimeLeftAndRates) {
  FakeClock clock(1000);
  std::ostringstream out;
  ProgressReporter reporter(clock, out, Style::kLines);
  reporter.update(at(0, 64));
  clock.advance(10);
  reporter.update(at(16, 64, 31'000'000, 12'000'000));
  EXPECT_EQ(out.str(),
            "  0 %  0/64 passes  0 rays/s\n"
            " 25 %  16/64 passes  0:30 left  3.1 Mrays/s  1.2 Mphotons/s\n");
}

TEST(Progress, WritesAtMostALineEachFiveSecondsAndOneAtTheEnd) {
  FakeClock clock;
  std::ostringstream out;
  ProgressReporter reporter(clock, out, Style::kLines);
  for (int i = 0; i < 100; ++i) {  // ten seconds
    reporter.update(at(i, 100));
    clock.advance(0.1);
  }
  EXPECT_EQ(lines(out.str()), 2U);
  reporter.finish(at(100, 100));
  EXPECT_EQ(lines(out.str()), 3U);
  EXPECT_NE(out.str().find("100 %  100/100 passes  0 rays/s  in 0:10\n"), std::string::npos);
  EXPECT_EQ(out.str().find('\r'), std::string::npos);
}

TEST(Progress, ABarStaysOnOneLineWithinTheTerminal) {
  FakeClock clock;
  std::ostringstream out;
  ProgressReporter reporter(clock, out, Style::kBar, 40);
  for (int i = 0; i <= 10; ++i) {
    reporter.update(at(i, 10, 123'456'789, 987'654'321));
    clock.advance(1);
  }
  EXPECT_EQ(lines(out.str()), 0U);
  reporter.finish(at(10, 10));
  EXPECT_EQ(lines(out.str()), 1U);
  std::istringstream redraws(out.str());
  std::string redraw;
  while (std::getline(redraws, redraw, '\r')) {
    if (!redraw.empty() && redraw.back() == '\n') redraw.pop_back();
    EXPECT_LT(redraw.size(), 40U) << redraw;
  }
}

TEST(Progress, ABarIsRedrawnAtMostTenTimesASecondAndCoversWhatWasLonger) {
  FakeClock clock;
  std::ostringstream out;
  ProgressReporter reporter(clock, out, Style::kBar, 200);
  for (int i = 0; i < 1000; ++i) {  // a second
    reporter.update(at(1, 1000, 5'000'000, 5'000'000));
    clock.advance(0.001);
  }
  const std::string first = out.str();
  const auto redraws = std::count(first.begin(), first.end(), '\r');
  EXPECT_GE(redraws, 9);
  EXPECT_LE(redraws, 11);
  out.str("");
  clock.advance(1);
  reporter.update(at(1000, 1000));
  EXPECT_GE(out.str().size(), first.substr(first.rfind('\r')).find_last_not_of(' '));
}

TEST(Progress, SilentWritesNothing) {
  FakeClock clock;
  std::ostringstream out;
  ProgressReporter reporter(clock, out, Style::kSilent);
  reporter.update(at(1, 2));
  clock.advance(100);
  reporter.finish(at(2, 2));
  EXPECT_TRUE(out.str().empty());
}

TEST(Progress, TimeLeftDoesNotCountWhatACheckpointHadDone) {
  FakeClock clock;
  std::ostringstream out;
  ProgressReporter reporter(clock, out, Style::kLines);
  reporter.update(at(50, 100));
  clock.advance(10);
  reporter.update(at(75, 100));  // 25 passes in 10 s, 25 to go
  EXPECT_NE(out.str().find(" 75 %  75/100 passes  0:10 left"), std::string::npos) << out.str();
}

TEST(Progress, WhicheverComesFirstDecidesTheShareDone) {
  Progress p = at(10, 100);
  EXPECT_DOUBLE_EQ(fraction_done(p, 0), 0.1);
  p.seconds_limit = 20;
  EXPECT_DOUBLE_EQ(fraction_done(p, 5), 0.25);
  p.error_target = 0.01;
  p.error = 0.0125;
  EXPECT_DOUBLE_EQ(fraction_done(p, 5), 0.64);
  EXPECT_DOUBLE_EQ(fraction_done(p, 1000), 1.0);
  EXPECT_DOUBLE_EQ(fraction_done(Progress{}, 1000), 0.0);
}

TEST(Progress, WritesTimesAndNumbersShortly) {
  EXPECT_EQ(clock_time(7), "0:07");
  EXPECT_EQ(clock_time(754.4), "12:34");
  EXPECT_EQ(clock_time(3723), "1:02:03");
  EXPECT_EQ(clock_time(-1), "0:00");
  EXPECT_EQ(clock_time(1e300), "2376:00:00");
  EXPECT_EQ(short_number(950), "950 ");
  EXPECT_EQ(short_number(3100), "3.1 k");
  EXPECT_EQ(short_number(999'999), "1.0 M");
  EXPECT_EQ(short_number(123'456'789), "123 M");
  EXPECT_EQ(short_number(1.5e9), "1.5 G");
}

}  // namespace
}  // namespace pf
