#include "jobs/benchmark/analysis.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace pf::bench {
namespace {

/// Samples of one budget, with the run that each is of.
using Samples = std::vector<const Sample*>;

std::vector<std::vector<Rgb>> images_of(const Samples& samples) {
  std::vector<std::vector<Rgb>> images;
  for (const Sample* sample : samples) {
    if (auto image = read_beauty(sample->exr)) images.push_back(std::move(image->pixels));
  }
  return images;
}

Group group_of(double budget, const Samples& samples, const Reference& reference) {
  Group g;
  g.budget = budget;
  g.runs = static_cast<int>(samples.size());
  const double share = 1.0 / g.runs;
  g.rel_mse_low = g.rel_mse_high = samples.front()->rel_mse;
  for (const Sample* s : samples) {
    g.seconds += share * s->seconds;
    g.cpu_seconds += share * s->cpu_seconds;
    g.photon_paths += share * static_cast<double>(s->photon_paths);
    g.rays += share * static_cast<double>(s->rays);
    g.peak_bytes += share * static_cast<double>(s->peak_bytes);
    g.passes += share * static_cast<double>(s->passes);
    g.rel_mse += share * s->rel_mse;
    g.rel_mse_corrected += share * s->rel_mse_corrected;
    g.rel_mse_low = std::min(g.rel_mse_low, s->rel_mse);
    g.rel_mse_high = std::max(g.rel_mse_high, s->rel_mse);
    g.rel_mse_trimmed += share * s->rel_mse_trimmed;
    g.rmse += share * s->rmse;
    g.hdr_flip += share * s->hdr_flip;
  }
  g.at_reference_noise = g.rel_mse_corrected <= reference.noise;
  if (samples.size() > 1) {
    const auto images = images_of(samples);
    g.relative = error_parts(images, reference.mean, reference.variance, true);
    g.absolute = error_parts(images, reference.mean, reference.variance, false);
  }
  return g;
}

void analyse_method(const BenchResult& bench, MethodResult& method, const Reference& reference) {
  std::map<double, Samples> by_budget;
  std::vector<std::vector<Point>> runs;
  for (const RunResult& run : method.runs) {
    runs.emplace_back();
    for (const Sample& sample : run.samples) {
      if (!run.error.empty() || !std::isfinite(sample.rel_mse)) continue;
      by_budget[sample.budget].push_back(&sample);
      if (!sample.at_reference_noise) runs.back().push_back({bench.seconds(sample), sample.rel_mse_corrected});
    }
  }
  for (const auto& [budget, samples] : by_budget) method.groups.push_back(group_of(budget, samples, reference));
  method.slope = fit_slope(runs);
  const std::vector<Point> curve = curve_of(bench, method);
  for (const double target : bench.suite.targets) method.times.push_back(time_to_error(curve, target));
}

}  // namespace

std::vector<Point> curve_of(const BenchResult& bench, const MethodResult& method) {
  std::vector<Point> curve;
  for (const Group& g : method.groups) curve.push_back({bench.seconds(g), g.rel_mse_corrected});
  return curve;
}

void analyse(BenchResult& bench) {
  for (SceneResult& scene : bench.scenes) {
    std::vector<Point> points;
    std::vector<std::pair<std::size_t, std::size_t>> which;
    for (std::size_t m = 0; m < scene.methods.size(); ++m) {
      MethodResult& method = scene.methods[m];
      method.groups.clear();
      method.times.clear();
      analyse_method(bench, method, scene.reference);
      for (std::size_t g = 0; g < method.groups.size(); ++g) {
        points.push_back({bench.seconds(method.groups[g]), method.groups[g].rel_mse});
        which.emplace_back(m, g);
      }
    }
    scene.front.clear();
    for (const std::size_t i : pareto_front(points)) scene.front.push_back(which[i]);
  }
}

}  // namespace pf::bench
