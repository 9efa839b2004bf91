#include "worker/progress.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include <fmt/format.h>

namespace pf {
namespace {

std::string rate(double count, double elapsed, std::string_view unit) {
  return fmt::format("{}{}/s", short_number(count / std::max(elapsed, 1e-3)), unit);
}

}  // namespace

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
    : clock_(clock), shown_(clock, out, style, columns), start_(clock.now()) {}

std::string ProgressReporter::line(const Progress& p, double elapsed) const {
  const double fraction = fraction_done(p, elapsed);
  std::string text = shown_.style() == Style::kBar ? progress_bar(fraction) : std::string();
  text += fmt::format("{:3.0f} %", std::floor(100.0 * fraction));
  if (p.passes_total > 0) {
    text += fmt::format("  {}/{} passes", p.passes_done, p.passes_total);
  } else {
    text += fmt::format("  {} passes", p.passes_done);
  }
  // What a checkpoint had done took none of this process's time.
  double at_start = 0.0;
  if (p.passes_total > 0) at_start = static_cast<double>(passes_at_start_) / static_cast<double>(p.passes_total);
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

void ProgressReporter::update(const Progress& progress) {
  if (passes_at_start_ < 0) passes_at_start_ = progress.passes_done;
  if (shown_.due()) shown_.show(line(progress, clock_.now() - start_));
}

void ProgressReporter::finish(const Progress& progress) {
  if (passes_at_start_ < 0) passes_at_start_ = progress.passes_done;
  const double elapsed = clock_.now() - start_;
  shown_.finish(fmt::format("{}  in {}", line(progress, elapsed), clock_time(elapsed)));
}

}  // namespace pf
