#include "jobs/benchmark/planner_report.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <fmt/format.h>

#include "jobs/benchmark/html.h"
#include "jobs/benchmark/planner_judgement.h"

namespace pf::bench {
namespace {

std::string ratio_text(const TimeRatio& ratio) {
  using Kind = TimeRatio::Kind;
  const char* sign = ratio.kind == Kind::kExact ? "" : ratio.kind == Kind::kAtMost ? "≤ " : "≥ ";
  return fmt::format("{}{:.2f}", sign, ratio.ratio);
}

/// Least and most of the error with terms turned round that the plan has `on` or `off`, in words.
std::string range_of(const BenchResult& bench, bool on) {
  double least = INFINITY, most = 0;
  int terms = 0;
  for (const SceneResult& scene : bench.scenes) {
    for (const Ablation& a : scene.ablations) {
      if (a.seeds == 0 || (a.planned == "on") != on) continue;
      least = std::min(least, a.error_ratio);
      most = std::max(most, a.error_ratio);
      ++terms;
    }
  }
  const char* const what = on ? "put in" : "left out";
  if (terms == 0) return fmt::format("No term that the plans have {} could be turned round. ", what);
  return fmt::format("Of {} terms that the plans have {} the other way has {:.2f} to {:.2f} times the error. ", terms,
                     what, least, most);
}

}  // namespace

std::string planner_html(const BenchResult& bench, std::size_t judged) {
  const auto name_of = [&](std::size_t method) { return escaped(bench.suite.methods[method].name); };
  std::string html = fmt::format(
      "<h3>The planner ({}): its time to an error over that of the soonest other method</h3><div "
      "class=\"wide\"><table><tr><th>scene</th>",
      name_of(judged));
  for (const double target : bench.suite.targets) html += fmt::format("<th>relMSE {:g}</th>", target);
  html += "<th>the least that another reached</th></tr>\n";
  std::vector<std::vector<std::optional<TimeRatio>>> columns(bench.suite.targets.size() + 1);
  const auto cell = [&](std::size_t column, const std::optional<TimeRatio>& ratio, const std::string& more) {
    columns[column].push_back(ratio);
    html += ratio ? fmt::format("<td>{}<br><span class=\"dim\">{}{}</span></td>", ratio_text(*ratio),
                                name_of(ratio->soonest), more)
                  : "<td>–</td>";
  };
  for (const SceneResult& scene : bench.scenes) {
    const PlannerOfScene found = judge_planner(bench, scene, judged);
    html += fmt::format("<tr><td>{}</td>", escaped(scene.scene.name));
    for (std::size_t t = 0; t < found.targets.size(); ++t) cell(t, found.targets[t], "");
    cell(found.targets.size(), found.least, ", " + error_text(found.least_error));
    html += "</tr>\n";
  }
  html += "<tr><td>median, worst</td>";
  for (const auto& column : columns) {
    const RatioSummary all = summary_of(column);
    html += all.scenes == 0 ? "<td>–</td>" : fmt::format("<td>{:.2f}, {:.2f}</td>", all.median, all.worst);
  }
  html +=
      "</tr></table></div><p class=\"dim\">Below each ratio the soonest other method. ≤: there with the first image; "
      "≥: not there at the end of the last budget, counted as if it had been then; –: no other method gets "
      "there.</p>\n";
  return html;
}

std::string ablations_html(const BenchResult& bench) {
  std::string rows;
  for (const SceneResult& scene : bench.scenes) {
    for (const Ablation& a : scene.ablations) {
      std::string method = bench.suite.methods[a.method].name;
      if (method != a.algorithm) method += ": " + a.algorithm;
      rows += fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>", escaped(scene.scene.name),
                          escaped(method), escaped(a.term), escaped(a.planned), escaped(a.instead));
      rows += a.seeds == 0 ? fmt::format("<td class=\"bad\" colspan=\"4\">{}</td></tr>\n", escaped(a.failure))
                           : fmt::format(
                                 "<td>{}</td><td>{:.3f}<br><span class=\"dim\">{:.3f} to {:.3f}</span></td>"
                                 "<td>{:.3g} s</td><td>{:.2f}</td></tr>\n",
                                 error_text(a.error), a.error_ratio, a.lowest_ratio, a.highest_ratio, a.seconds,
                                 a.seconds_ratio);
    }
  }
  if (rows.empty()) return "";
  return "<h3>The planner's terms: each decided the other way round, at equal passes</h3><div "
         "class=\"wide\"><table><tr><th>scene</th><th>method</th><th>term</th><th>planned</th><th>instead</th>"
         "<th>error as planned</th><th>the other way's over it</th><th>CPU time</th><th>the other way's over "
         "it</th></tr>\n" +
         rows + "</table></div><p class=\"dim\">" + range_of(bench, true) + range_of(bench, false) +
         "Errors are relMSE without the worst thousandth of the pixels, means over the seeds; below a ratio the least "
         "and the most of single seeds. A term that a scene lacks cannot be put in; a sky or a medium that is left out "
         "is another picture.</p>\n";
}

}  // namespace pf::bench
