#include "common/base/status_line.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <ostream>
#include <string_view>

#include <fmt/format.h>

namespace pf {
namespace {

constexpr double kBarSeconds = 0.1;
constexpr double kLineSeconds = 5.0;
constexpr int kBarCells = 20;
constexpr double kLongestTime = 99.0 * 86400.0;  // beyond, a time left says nothing

}  // namespace

std::string progress_bar(double fraction) {
  const int full = static_cast<int>(std::lround(fraction * kBarCells));
  return fmt::format("[{:#<{}}{:.<{}}] ", "", full, "", kBarCells - full);
}

std::string clock_time(double seconds) {
  const auto whole = static_cast<std::int64_t>(std::llround(std::clamp(seconds, 0.0, kLongestTime)));
  const std::int64_t hours = whole / 3600;
  if (hours > 0) return fmt::format("{}:{:02}:{:02}", hours, whole / 60 % 60, whole % 60);
  return fmt::format("{}:{:02}", whole / 60, whole % 60);
}

std::string short_number(double value) {
  constexpr std::array<std::string_view, 5> kUnits = {"", "k", "M", "G", "T"};
  std::size_t unit = 0;
  while (value >= 999.5 && unit + 1 < kUnits.size()) {
    value /= 1000.0;
    ++unit;
  }
  return fmt::format("{:.{}f} {}", value, unit > 0 && value < 99.95 ? 1 : 0, kUnits[unit]);
}

StatusLine::StatusLine(const Clock& clock, std::ostream& out, Style style, int columns)
    : clock_(clock),
      out_(out),
      style_(style),
      columns_(static_cast<std::size_t>(std::max(20, columns))),
      last_shown_(clock.now() - kLineSeconds) {}

bool StatusLine::due() {
  if (style_ == Style::kSilent) return false;
  const double now = clock_.now();
  if (now - last_shown_ < (style_ == Style::kBar ? kBarSeconds : kLineSeconds)) return false;
  last_shown_ = now;
  return true;
}

void StatusLine::show(const std::string& text) {
  if (style_ == Style::kSilent) return;
  if (style_ == Style::kLines) {
    out_ << text << '\n' << std::flush;
    return;
  }
  // The last column stays free: a character there makes some terminals wrap. Blanks cover what is left of a
  // longer line.
  const std::string shown = text.substr(0, columns_ - 1);
  out_ << '\r' << shown << std::string(drawn_ > shown.size() ? drawn_ - shown.size() : 0, ' ') << std::flush;
  drawn_ = shown.size();
}

void StatusLine::finish(const std::string& text) {
  show(text);
  if (style_ == Style::kBar) out_ << '\n' << std::flush;
  drawn_ = 0;
}

}  // namespace pf
