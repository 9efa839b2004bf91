#include "worker/progress.h"

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

std::string bar(double fraction) {
  const int full = static_cast<int>(std::lround(fraction * kBarCells));
  return fmt::format("[{:#<{}}{:.<{}}] ", "", full, "", kBarCells - full);
}

std::string rate(double count, double elapsed, std::string_view unit) {
  return fmt::format("{}{}/s", short_number(count / std::max(elapsed, 1e-3)), unit);
}

}  // namespace

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

double fraction_done(const Progress& p, double elapsed) {
  double fraction = 0.0;
  if (p.passes_total > 0) {
    fraction = static_cast<double>(p.passes_done) / static_cast<double>(p.passes_total);
  }
  if (p.seconds_limit > 0) fraction = std::max(fraction, elapsed / p.seconds_limit);
  if (p.error_target > 0 && p.error > 0) {
    const double ratio = p.error_target / p.error;
    fraction = std::max(fraction, ratio * ratio);
  }
  return std::clamp(fraction, 0.0, 1.0);
}

ProgressReporter::ProgressReporter(const Clock& clock, std::ostream& out, Style style, int columns)
    : clock_(clock),
      out_(out),
      style_(style),
      columns_(static_cast<std::size_t>(std::max(20, columns))),
      start_(clock.now()),
      last_shown_(start_ - kLineSeconds) {}

std::string ProgressReporter::line(const Progress& p, double elapsed) const {
  const double fraction = fraction_done(p, elapsed);
  std::string text = style_ == Style::kBar ? bar(fraction) : std::string();
  text += fmt::format("{:3.0f} %", std::floor(100.0 * fraction));
  if (p.passes_total > 0) {
    text += fmt::format("  {}/{} passes", p.passes_done, p.passes_total);
  } else {
    text += fmt::format("  {} passes", p.passes_done);
  }
  // What a checkpoint had done took none of this process's time.
  double at_start = 0.0;
  if (p.passes_total > 0)
    at_start = static_cast<double>(passes_at_start_) / static_cast<double>(p.passes_total);
  if (fraction > at_start && fraction < 1.0) {
    const double by_work = elapsed * (1.0 - fraction) / (fraction - at_start);
    const double left = p.seconds_limit > 0 ? std::min(by_work, p.seconds_limit - elapsed) : by_work;
    text += fmt::format("  {} left", clock_time(left));
  }
  if (p.error > 0) text += fmt::format("  error {:.2g}", p.error);
  text += "  " + rate(static_cast<double>(p.rays), elapsed, "rays");
  if (p.photons > 0) text += "  " + rate(static_cast<double>(p.photons), elapsed, "photons");
  return text;
}

void ProgressReporter::draw(const std::string& text) {
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

void ProgressReporter::update(const Progress& progress) {
  if (passes_at_start_ < 0) passes_at_start_ = progress.passes_done;
  if (style_ == Style::kSilent) return;
  const double now = clock_.now();
  if (now - last_shown_ < (style_ == Style::kBar ? kBarSeconds : kLineSeconds)) return;
  last_shown_ = now;
  draw(line(progress, now - start_));
}

void ProgressReporter::finish(const Progress& progress) {
  if (style_ == Style::kSilent) return;
  if (passes_at_start_ < 0) passes_at_start_ = progress.passes_done;
  const double elapsed = clock_.now() - start_;
  draw(fmt::format("{}  in {}", line(progress, elapsed), clock_time(elapsed)));
  if (style_ == Style::kBar) out_ << '\n' << std::flush;
}

}  // namespace pf
