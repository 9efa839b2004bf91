#pragma once

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "jobs/benchmark/analysis.h"
#include "jobs/benchmark/statistics.h"

namespace pf::bench {

/// A curve of a chart; both axes are logarithmic, so that points that are not above zero are left out.
struct Series {
  std::string label;
  std::string color;  ///< #rrggbb
  int symbol = 7;     ///< of gnuplot
  bool dashed = false;
  std::vector<Point> points;
  std::vector<Point> scatter;  ///< single runs, drawn small
};

struct Chart {
  std::string file;  ///< without extension
  std::string title, x, y;
  std::vector<Series> series;
  std::vector<Point> front;  ///< drawn as steps
  double floor = 0;          ///< a level below which errors say nothing; 0: none
  std::string floor_label;
};

/// What may be drawn on logarithmic axes.
[[nodiscard]] inline bool drawable(const Point& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && p.x > 0 && p.y > 0;
}

/// Charts of one scene: error over time with the Pareto front, HDR-FLIP over time, error over memory, rays and photons,
/// and bias and variance over time; those without a point are left out.
[[nodiscard]] std::vector<Chart> charts_of(const BenchResult& bench, const SceneResult& scene);

/// The script that draws all of them, each as SVG and PNG, and all scenes' errors over time as `overview`, into
/// `folder`.
[[nodiscard]] std::string gnuplot_script(const std::vector<Chart>& charts, const std::vector<Chart>& overview,
                                         const std::filesystem::path& folder);

/// Draws them. Errors: kInternal, kUnavailable.
[[nodiscard]] Result<void> draw_charts(const std::filesystem::path& gnuplot, const std::vector<Chart>& charts,
                                       const std::vector<Chart>& overview, const std::filesystem::path& folder);

}  // namespace pf::bench
