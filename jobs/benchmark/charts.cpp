#include "jobs/benchmark/charts.h"

#include <algorithm>
#include <array>
#include <functional>

#include <fmt/format.h>

#include "common/spec/key_table.h"

namespace pf::bench {
namespace {

/// Okabe and Ito's colours, which people with any colour vision tell apart, one for each integrator type but auto.
constexpr std::array<std::string_view, 8> kColors = {"#7f7f7f", "#000000", "#e69f00", "#56b4e9",
                                                     "#009e73", "#cc79a7", "#d55e00", "#0072b2"};
constexpr std::array kSymbols = {7, 5, 9, 11, 13, 15, 4, 6};

struct Look {
  std::string color;
  int symbol = 7;
};

/// The colour says the integrator; the symbol tells parameter sets of one integrator apart.
std::vector<Look> looks(const Suite& suite) {
  std::vector<Look> result;
  const auto names = spec::integrator_names();
  for (std::size_t m = 0; m < suite.methods.size(); ++m) {
    const auto type = static_cast<std::size_t>(std::ranges::find(names, suite.methods[m].type) - names.begin());
    std::size_t same = 0;
    for (std::size_t other = 0; other < m; ++other) same += suite.methods[other].type == suite.methods[m].type;
    result.push_back({std::string(kColors[type % kColors.size()]), kSymbols[(type + same) % kSymbols.size()]});
  }
  return result;
}

using OfGroup = std::function<double(const Group&)>;
using OfSample = std::function<double(const Sample&)>;

struct Axes {
  OfGroup x, y;
  OfSample sample_x, sample_y;  ///< empty: single runs are not drawn
};

std::vector<Series> series_of(const BenchResult& bench, const SceneResult& scene, const Axes& axes) {
  const std::vector<Look> look = looks(bench.suite);
  std::vector<Series> all;
  for (std::size_t m = 0; m < scene.methods.size(); ++m) {
    Series series{bench.suite.methods[m].name, look[m].color, look[m].symbol, false, {}, {}};
    for (const Group& g : scene.methods[m].groups) series.points.push_back({axes.x(g), axes.y(g)});
    for (const RunResult& run : scene.methods[m].runs) {
      for (const Sample& s : run.samples) {
        if (axes.sample_x && run.error.empty()) series.scatter.push_back({axes.sample_x(s), axes.sample_y(s)});
      }
    }
    all.push_back(std::move(series));
  }
  return all;
}

bool empty(const Chart& chart) {
  return std::ranges::none_of(chart.series, [](const Series& s) { return std::ranges::any_of(s.points, drawable); });
}

Chart parts_chart(const BenchResult& bench, const SceneResult& scene, const std::string& time_label) {
  const OfGroup seconds = [&](const Group& g) { return bench.seconds(g); };
  const auto part = [](double ErrorParts::*member) {
    return [member](const Group& g) { return g.relative ? (*g.relative).*member : 0.0; };
  };
  Chart chart{scene.scene.name + "-parts",
              "bias² (full) and variance (dashed) apart",
              time_label,
              "relative to the reference",
              {},
              {},
              0,
              {}};
  chart.series = series_of(bench, scene, {seconds, part(&ErrorParts::bias2), {}, {}});
  for (Series& s : series_of(bench, scene, {seconds, part(&ErrorParts::variance), {}, {}})) {
    s.dashed = true;
    s.label.clear();
    chart.series.push_back(std::move(s));
  }
  return chart;
}

}  // namespace

std::vector<Chart> charts_of(const BenchResult& bench, const SceneResult& scene) {
  const std::string& name = scene.scene.name;
  const std::string time_label = bench.suite.time == TimeAxis::kCpu ? "seconds of processor time" : "seconds";
  const OfGroup seconds = [&](const Group& g) { return bench.seconds(g); };
  const OfSample sample_seconds = [&](const Sample& s) { return bench.seconds(s); };
  const OfGroup error = [](const Group& g) { return g.rel_mse; };
  const OfSample sample_error = [](const Sample& s) { return s.rel_mse; };

  Chart main{name + "-error-time",
             name,
             time_label,
             "relMSE",
             series_of(bench, scene, {seconds, error, sample_seconds, sample_error}),
             {},
             0,
             {}};
  for (const auto& [m, g] : scene.front)
    main.front.push_back({seconds(scene.methods[m].groups[g]), scene.methods[m].groups[g].rel_mse});
  main.floor = scene.reference.noise;
  main.floor_label = "noise of the reference";
  const auto more = [&](const char* what, const std::string& title, const std::string& x, const OfGroup& of_x,
                        const OfGroup& of_y, const std::string& y) {
    return Chart{name + "-" + what, title, x, y, series_of(bench, scene, {of_x, of_y, {}, {}}), {}, 0, {}};
  };
  std::vector<Chart> charts = {
      std::move(main),
      more(
          "trimmed-time", "without the worst 0.1 % of pixels", time_label, seconds,
          [](const Group& g) { return g.rel_mse_trimmed; }, "relMSE trimmed"),
      more(
          "flip-time", "what a person sees", time_label, seconds, [](const Group& g) { return g.hdr_flip; },
          "mean HDR-FLIP"),
      more(
          "error-memory", "memory", "MiB at peak", [](const Group& g) { return g.peak_bytes / 1048576.0; }, error,
          "relMSE"),
      more(
          "error-rays", "rays", "rays", [](const Group& g) { return g.rays; }, error, "relMSE"),
      more(
          "error-photons", "photons", "photon paths", [](const Group& g) { return g.photon_paths; }, error, "relMSE"),
      parts_chart(bench, scene, time_label)};
  std::erase_if(charts, empty);
  return charts;
}

}  // namespace pf::bench
