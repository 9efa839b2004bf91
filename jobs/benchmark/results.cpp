#include "jobs/benchmark/results.h"

#include <array>
#include <cmath>
#include <iterator>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "jobs/benchmark/planner_judgement.h"

namespace pf::bench {
namespace {

using nlohmann::ordered_json;

/// JSON has no NaN and no infinity.
ordered_json number(double value) { return std::isfinite(value) ? ordered_json(value) : ordered_json(); }

std::string field(const ordered_json& value) {
  if (value.is_null()) return "";
  if (!value.is_string()) return value.dump();
  std::string text = value.get<std::string>();
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string in_quotes = "\"";
  for (const char c : text) in_quotes.append(c == '"' ? 2 : 1, c);  // RFC 4180
  return in_quotes + '"';
}

/// What a sample's row says of its run.
ordered_json run_json(const BenchResult& bench, const SceneResult& scene, const RunResult& result) {
  const MethodEntry& method = bench.suite.methods[result.run->method];
  return {{"scene", scene.scene.name},
          {"method", method.name},
          {"type", method.type},
          {"repetition", result.run->repetition},
          {"seed", result.run->seed},
          {"run", result.run->id},
          {"error", result.error},
          {"load_seconds", result.load_seconds},
          {"prepare_seconds", result.prepare_seconds},
          {"wall_seconds", result.wall_seconds},
          {"load_average", result.load_average}};
}

ordered_json sample_json(const Sample& s) {
  ordered_json json = figures_json(s);
  json.update({{"rel_mse", number(s.rel_mse)},
               {"rel_mse_corrected", number(s.rel_mse_corrected)},
               {"rel_mse_trimmed", number(s.rel_mse_trimmed)},
               {"rmse", number(s.rmse)},
               {"hdr_flip", number(s.hdr_flip)},
               {"mean_ratio", number(s.mean_ratio)},
               {"at_reference_noise", s.at_reference_noise},
               {"nonfinite_pixels", s.nonfinite_pixels},
               {"negative_pixels", s.negative_pixels}});
  return json;
}

ordered_json parts_json(const std::optional<ErrorParts>& parts) {
  if (!parts) return {};
  return {{"mse", number(parts->mse)},
          {"bias2", number(parts->bias2)},
          {"bias2_error", number(parts->bias2_error)},
          {"variance", number(parts->variance)},
          {"runs", parts->runs}};
}

ordered_json group_json(const Group& g) {
  return {{"budget", g.budget},
          {"runs", g.runs},
          {"seconds", g.seconds},
          {"cpu_seconds", g.cpu_seconds},
          {"passes", g.passes},
          {"photon_paths", g.photon_paths},
          {"rays", g.rays},
          {"peak_bytes", g.peak_bytes},
          {"rel_mse", number(g.rel_mse)},
          {"rel_mse_corrected", number(g.rel_mse_corrected)},
          {"rel_mse_trimmed", number(g.rel_mse_trimmed)},
          {"rel_mse_low", number(g.rel_mse_low)},
          {"rel_mse_high", number(g.rel_mse_high)},
          {"rmse", number(g.rmse)},
          {"hdr_flip", number(g.hdr_flip)},
          {"at_reference_noise", g.at_reference_noise},
          {"relative_parts", parts_json(g.relative)},
          {"absolute_parts", parts_json(g.absolute)}};
}

ordered_json slope_json(const std::optional<SlopeFit>& fit) {
  if (!fit) return {};
  return {{"slope", fit->line.slope},       {"low", number(fit->line.low)},
          {"high", number(fit->line.high)}, {"log10_error_at_1_s", fit->line.intercept},
          {"points", fit->line.points},     {"interval_from", fit->from_runs ? "runs" : "residuals"}};
}

ordered_json time_json(double target, const TimeToError& time) {
  using Kind = TimeToError::Kind;
  const char* kind = time.kind == Kind::kReached       ? "reached"
                     : time.kind == Kind::kBeforeFirst ? "at_most"
                                                       : "more_than";
  return {{"target", target}, {"seconds", time.seconds}, {"kind", kind}};
}

ordered_json method_json(const BenchResult& bench, std::size_t m, const MethodResult& method) {
  ordered_json groups = ordered_json::array(), times = ordered_json::array();
  for (const Group& g : method.groups) groups.push_back(group_json(g));
  for (std::size_t t = 0; t < method.times.size(); ++t)
    times.push_back(time_json(bench.suite.targets[t], method.times[t]));
  return {{"method", bench.suite.methods[m].name},
          {"type", bench.suite.methods[m].type},
          {"set", bench.suite.methods[m].set},
          {"slope", slope_json(method.slope)},
          {"times", std::move(times)},
          {"groups", std::move(groups)}};
}

ordered_json ratio_json(const BenchResult& bench, double target, const std::optional<TimeRatio>& ratio) {
  if (!ratio) return {{"target", number(target)}, {"ratio", nullptr}, {"kind", "no_rival"}, {"soonest", nullptr}};
  using Kind = TimeRatio::Kind;
  const char* kind = ratio->kind == Kind::kExact ? "exact" : ratio->kind == Kind::kAtMost ? "at_most" : "at_least";
  return {{"target", target},
          {"ratio", ratio->ratio},
          {"kind", kind},
          {"soonest", bench.suite.methods[ratio->soonest].name}};
}

/// Judgements of every method of type "auto".
ordered_json planner_json(const BenchResult& bench, const SceneResult& scene) {
  ordered_json all = ordered_json::array();
  for (std::size_t m = 0; m < scene.methods.size(); ++m) {
    if (bench.suite.methods[m].type != "auto") continue;
    const PlannerOfScene found = judge_planner(bench, scene, m);
    ordered_json targets = ordered_json::array();
    for (std::size_t t = 0; t < found.targets.size(); ++t)
      targets.push_back(ratio_json(bench, bench.suite.targets[t], found.targets[t]));
    all.push_back({{"method", bench.suite.methods[m].name},
                   {"targets", std::move(targets)},
                   {"least", ratio_json(bench, found.least_error, found.least)}});
  }
  return all;
}

ordered_json ablation_json(const BenchResult& bench, const Ablation& a) {
  const bool known = a.seeds > 0;
  const auto figure = [&](double value) { return known ? number(value) : ordered_json(); };
  return {{"method", bench.suite.methods[a.method].name},
          {"algorithm", a.algorithm},
          {"term", a.term},
          {"planned", a.planned},
          {"instead", a.instead},
          {"seeds", a.seeds},
          {"rel_mse_trimmed", figure(a.error)},
          {"error_ratio", figure(a.error_ratio)},
          {"lowest_ratio", figure(a.lowest_ratio)},
          {"highest_ratio", figure(a.highest_ratio)},
          {"cpu_seconds", figure(a.seconds)},
          {"seconds_ratio", figure(a.seconds_ratio)},
          {"failure", a.failure}};
}

ordered_json scene_json(const BenchResult& bench, const SceneResult& scene) {
  const Reference& r = scene.reference;
  ordered_json methods = ordered_json::array(), front = ordered_json::array(), ablations = ordered_json::array();
  for (const Ablation& a : scene.ablations) ablations.push_back(ablation_json(bench, a));
  for (std::size_t m = 0; m < scene.methods.size(); ++m) methods.push_back(method_json(bench, m, scene.methods[m]));
  for (const auto& [m, g] : scene.front) {
    front.push_back({{"method", bench.suite.methods[m].name}, {"budget", scene.methods[m].groups[g].budget}});
  }
  return {{"scene", scene.scene.name},
          {"hash", scene.scene.hash},
          {"reference",
           {{"key", r.key()},
            {"error", r.error},
            {"type", r.type},
            {"may_be_biased", r.biased},
            {"width", r.width},
            {"height", r.height},
            {"passes_of_each_half", r.passes},
            {"seconds", r.seconds},
            {"noise", number(r.noise)},
            {"flip_between_halves", number(r.flip_between_halves)}}},
          {"front", std::move(front)},
          {"planner", planner_json(bench, scene)},
          {"ablations", std::move(ablations)},
          {"methods", std::move(methods)}};
}

}  // namespace

ordered_json results_json(const BenchResult& bench) {
  ordered_json scenes = ordered_json::array(), runs = ordered_json::array();
  for (const SceneResult& scene : bench.scenes) {
    scenes.push_back(scene_json(bench, scene));
    for (const MethodResult& method : scene.methods) {
      for (const RunResult& result : method.runs) {
        ordered_json run = run_json(bench, scene, result);
        run["warnings"] = result.warnings;
        run["samples"] = ordered_json::array();
        for (const Sample& sample : result.samples) run["samples"].push_back(sample_json(sample));
        runs.push_back(std::move(run));
      }
    }
  }
  const Suite& s = bench.suite;
  return {{"results_version", kResultsVersion},
          {"suite",
           {{"name", s.name},
            {"budgets_in", s.by_seconds() ? "seconds" : "passes"},
            {"repetitions", s.repetitions},
            {"threads", s.threads},
            {"shuffle", s.shuffle},
            {"time", s.time == TimeAxis::kCpu ? "cpu" : "wall"},
            {"targets", s.targets}}},
          {"machine", bench.machine},
          {"scenes", std::move(scenes)},
          {"runs", std::move(runs)}};
}

std::string results_csv(const BenchResult& bench) {
  std::string csv;
  const auto line = [&csv](const ordered_json& row, bool names) {
    std::string separator;
    for (const auto& [name, value] : row.items()) csv += std::exchange(separator, ",") + (names ? name : field(value));
    csv += "\n";
  };
  for (const SceneResult& scene : bench.scenes) {
    for (const MethodResult& method : scene.methods) {
      for (const RunResult& result : method.runs) {
        std::vector<Sample> samples = result.samples;
        ordered_json none = sample_json({});
        for (auto& value : none) value = nullptr;
        if (samples.empty()) samples.emplace_back();
        for (const Sample& sample : samples) {
          ordered_json row = run_json(bench, scene, result);
          row.update(result.samples.empty() ? none : sample_json(sample));
          if (csv.empty()) line(row, true);
          line(row, false);
        }
      }
    }
  }
  return csv;
}

std::string results_table(const BenchResult& bench) {
  std::string text = "| scene |";
  for (const MethodEntry& method : bench.suite.methods) text += fmt::format(" {} |", method.name);
  text += "\n| --- |";
  for (std::size_t m = 0; m < bench.suite.methods.size(); ++m) text += " --- |";
  text += "\n";
  for (const SceneResult& scene : bench.scenes) {
    text += fmt::format("| {} |", scene.scene.name);
    for (const MethodResult& method : scene.methods) {
      if (method.groups.empty()) {
        text += method.runs.empty() ? " – |" : " failed |";
        continue;
      }
      const Group& g = method.groups.back();
      text += fmt::format(" {:.3g} s, {:.2e}{}, {:.3f} |", bench.seconds(g), g.rel_mse, g.at_reference_noise ? "*" : "",
                          g.hdr_flip);
    }
    text += "\n";
  }
  return text;
}

}  // namespace pf::bench
