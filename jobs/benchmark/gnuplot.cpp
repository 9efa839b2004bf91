// Charts as a script for gnuplot, and gnuplot run on it.

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "jobs/benchmark/charts.h"
#include "jobs/process.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

constexpr double kDrawSeconds = 300;  // for all charts of a bench: far more than they take
constexpr std::string_view kStyle =
    "set encoding utf8\n"
    "set border 3 lc rgb '#888888'\n"
    "set tics nomirror out tc rgb '#444444'\n"
    "set grid xtics ytics lc rgb '#e4e4e4' lw 0.7 dt 1\n"
    "set logscale xy\n"
    "set key outside right top Left reverse noenhanced samplen 1.6 spacing 1.15 tc rgb '#222222'\n";

struct Range {
  double low = std::numeric_limits<double>::infinity(), high = 0;
  void add(double v) {
    low = std::min(low, v);
    high = std::max(high, v);
  }
  [[nodiscard]] Range padded() const { return {low / 1.25, high * 1.25}; }
};

/// In double quotes, where gnuplot knows escapes.
std::string in_quotes(std::string_view text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += c == '\n' ? ' ' : c;
  }
  return result + '"';
}

std::string number_label(double v) {
  if (v >= 1e9) return fmt::format("{:g} G", v / 1e9);
  if (v >= 1e6) return fmt::format("{:g} M", v / 1e6);
  if (v >= 1e4) return fmt::format("{:g} k", v / 1e3);
  return fmt::format("{:g}", v);
}

/// Marks at round numbers, as many as the range has room for; `powers` writes them as 10^n.
std::string tics(const Range& range, bool powers) {
  const double decades = std::log10(range.high / range.low);
  const std::vector<double> digits =
      decades > 2.2   ? std::vector<double>{1}
      : decades > 0.7 ? std::vector<double>{1, 2, 5}
      : decades > 0.3 ? std::vector<double>{1, 1.5, 2, 3, 4, 5, 7}
                      : std::vector<double>{1, 1.1, 1.2, 1.35, 1.5, 1.75, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8, 9};
  const int first = static_cast<int>(std::floor(std::log10(range.low)));
  const int last = static_cast<int>(std::ceil(std::log10(range.high)));
  std::string text;
  for (int e = first; e <= last; ++e) {
    for (const double digit : digits) {
      const double value = digit * std::pow(10.0, e);
      if (value < range.low || value > range.high) continue;
      std::string label = number_label(value);
      if (powers) label = digit == 1 ? fmt::format("10^{{{}}}", e) : fmt::format("{:g}·10^{{{}}}", digit, e);
      text += fmt::format("{}{} {:g}", text.empty() ? "" : ", ", in_quotes(label), value);
    }
  }
  return text.empty() ? "autofreq" : fmt::format("({})", text);
}

std::string block(const std::string& name, const std::vector<Point>& points) {
  std::string text = fmt::format("{} << EOD\n", name);
  for (const Point& p : points) {
    if (drawable(p)) text += fmt::format("{:.9g} {:.9g}\n", p.x, p.y);
  }
  return text + "EOD\n";
}

bool any(const std::vector<Point>& points) { return std::ranges::any_of(points, drawable); }

/// Data and plot command of one chart; `names` numbers the data blocks.
class Plot {
 public:
  Plot(const Chart& chart, int& names, bool small) : chart_(chart), names_(names), small_(small) {
    for (const Series& s : chart.series) {
      for (const auto* points : {&s.points, &s.scatter}) {
        for (const Point& p : *points) {
          if (drawable(p)) x_.add(p.x), y_.add(p.y);
        }
      }
    }
    if (chart.floor > 0 && std::isfinite(chart.floor) && chart.floor > 0.02 * y_.low) y_.add(chart.floor);
    x_ = x_.padded();
    y_ = y_.padded();
  }

  /// The commands; curves first, so that the key names them in the suite's order.
  std::string text() {
    floor();
    front();
    for (const Series& series : chart_.series) add(series);
    std::string text = data_;
    text +=
        fmt::format("set title {} noenhanced font ',{}' tc rgb '#222222'\n", in_quotes(chart_.title), small_ ? 11 : 13);
    text += fmt::format("set xlabel {}\nset ylabel {}\n", in_quotes(chart_.x), in_quotes(chart_.y));
    text += fmt::format("set xrange [{:g}:{:g}]\nset yrange [{:g}:{:g}]\n", x_.low, x_.high, y_.low, y_.high);
    text += fmt::format("set xtics {}\nset ytics {}\n", tics(x_, false), tics(y_, true));
    text += "plot " + plots_ + "\n";
    return text;
  }

 private:
  std::string keep(const std::vector<Point>& points) {
    std::string name = fmt::format("$d{}", names_++);
    data_ += block(name, points);
    return name;
  }
  void plot(const std::string& what) { plots_ += (plots_.empty() ? "" : ", \\\n  ") + what; }

  void front() {
    if (!any(chart_.front)) return;
    std::vector<Point> steps = chart_.front;
    steps.push_back({x_.high, steps.back().y});  // what the last one reaches stays reached
    plot(fmt::format("{} using 1:2 with steps lw {} lc rgb '#d8d8d8' title {}", keep(steps), small_ ? 5 : 9,
                     small_ ? "''" : in_quotes("Pareto front")));
  }
  void floor() {
    if (!(chart_.floor > y_.low)) return;
    plot(fmt::format("{:.9g} with lines lw 1 dt 3 lc rgb '#666666' title {}", chart_.floor,
                     small_ ? "''" : in_quotes(chart_.floor_label)));
  }
  void add(const Series& s) {
    if (any(s.scatter) && !small_) {
      plot(fmt::format("{} using 1:2 with points pt {} ps 0.35 lc rgb '{}' title ''", keep(s.scatter), s.symbol,
                       s.color));
    }
    if (!any(s.points)) return;
    plot(fmt::format("{} using 1:2 with linespoints pt {} ps {} lw {} dt {} lc rgb '{}' title {}", keep(s.points),
                     s.symbol,
                     s.dashed ? 0.0
                     : small_ ? 0.7
                              : 0.9,
                     small_     ? 1.5
                     : s.dashed ? 1.4
                                : 2.2,
                     s.dashed ? 2 : 1, s.color, small_ || s.label.empty() ? "''" : in_quotes(s.label)));
  }

  const Chart& chart_;
  int& names_;
  bool small_;
  Range x_, y_;
  std::string data_, plots_;
};

std::string terminal(bool svg, int width, int height, int font) {
  // PNGs are drawn at twice the size, for screens of today.
  return svg ? fmt::format("set terminal svg size {},{} font 'Helvetica,Arial,sans-serif,{}' background '#ffffff'\n",
                           width, height, font)
             : fmt::format("set terminal pngcairo size {},{} font 'Sans,{}' fontscale 2 linewidth 2 pointscale 2\n",
                           2 * width, 2 * height, font - 3);
}

/// All scenes side by side; the last place has the names of the curves.
std::string overview_text(const std::vector<Chart>& charts, int& names, const fs::path& folder) {
  const int places = static_cast<int>(charts.size()) + 1;
  const int columns = places <= 3 ? places : static_cast<int>(std::ceil(std::sqrt(places)));
  const int rows = (places + columns - 1) / columns;
  std::string text;
  for (const bool svg : {true, false}) {
    text += terminal(svg, 260 * columns, 230 * rows, 10);
    text += fmt::format("set output {}\n", in_quotes((folder / (svg ? "overview.svg" : "overview.png")).string()));
    text += fmt::format("set multiplot layout {},{}\nset key off\n", rows, columns);
    for (const Chart& chart : charts) {
      Chart one = chart;
      one.x = one.y = "";
      text += Plot(one, names, true).text();
    }
    text +=
        "unset title\nunset xlabel\nunset ylabel\nunset border\nunset xtics\nunset ytics\nunset grid\n"
        "set key inside center center vertical maxrows 20 Left reverse noenhanced samplen 2 spacing 1.05\nset xrange "
        "[1:10]\nset yrange [1:10]\nplot ";
    for (const Series& s : charts.front().series) {
      text += fmt::format("NaN with linespoints pt {} ps 0.7 lw 2 lc rgb '{}' title {}, ", s.symbol, s.color,
                          in_quotes(s.label));
    }
    text +=
        "NaN with lines lw 6 lc rgb '#d8d8d8' title 'Pareto front', NaN with lines lw 0.1 lc rgb '#ffffff' title ' ', "
        "NaN with lines lw 0.1 lc rgb '#ffffff' title 'up: relMSE', NaN with lines lw 0.1 lc rgb '#ffffff' title " +
        in_quotes("right: " + charts.front().x) + "\nunset multiplot\nunset output\nreset\n" + std::string(kStyle);
  }
  return text;
}

}  // namespace

std::string gnuplot_script(const std::vector<Chart>& charts, const std::vector<Chart>& overview,
                           const fs::path& folder) {
  std::string text(kStyle);
  int names = 0;
  for (const Chart& chart : charts) {
    const std::string commands = Plot(chart, names, false).text();
    for (const bool svg : {true, false}) {
      text += terminal(svg, 680, 420, 13);
      text += fmt::format("set output {}\n", in_quotes((folder / (chart.file + (svg ? ".svg" : ".png"))).string()));
      text += commands + "unset output\n";
    }
  }
  if (!overview.empty()) text += overview_text(overview, names, folder);
  return text;
}

Result<void> draw_charts(const fs::path& gnuplot, const std::vector<Chart>& charts, const std::vector<Chart>& overview,
                         const fs::path& folder) {
  const fs::path script = folder / "charts.gnuplot";
  if (auto written = write_file_atomically(script, gnuplot_script(charts, overview, folder)); !written) return written;
  const auto end = run_and_capture(gnuplot, {script.string()}, kDrawSeconds);
  if (!end) return tl::unexpected(end.error());
  if (end->end.exit_code != 0 || end->end.signal != 0) {
    return fail(ErrorKind::kInternal,
                fmt::format("{} failed on {}; run it by hand to see why", gnuplot.string(), script.string()));
  }
  return {};
}

}  // namespace pf::bench
