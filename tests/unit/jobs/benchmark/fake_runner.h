#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "common/film/image.h"
#include "jobs/benchmark/runner.h"

namespace pf::bench {

/// Stands for the renderer: a grey image with noise that falls with the budget, at once. Can be told to fail, to be
/// interrupted, or to leave pixels that are no numbers.
class FakeRunner final : public Runner {
 public:
  std::vector<std::string> rendered;  ///< `type seed` of every call that came to an end
  int interrupt_after = -1;           ///< calls; below zero: never
  std::string fails;                  ///< integrator.type whose renders fail
  std::string broken;                 ///< integrator.type whose images hold a NaN and a negative pixel
  std::string worse;                  ///< a setting with which images have twice the noise, "table.key=value"
  nlohmann::json plan_document;       ///< what every job's plan is; null: it cannot be made
  std::vector<RenderOrder> orders;    ///< of every call that came to an end

  Result<RenderOutcome> render(const RenderOrder& order, const std::function<void(double)>& tick) override {
    if (interrupt_after == 0) {
      std::ofstream(order.out / "image.snapshot-1.exr") << "half a file";
      return fail(ErrorKind::kInterrupted, "interrupted");
    }
    if (interrupt_after > 0) --interrupt_after;
    tick(0.5);
    const std::string type = value(order, "integrator.type");
    const std::string seed = value(order, "integrator.seed");
    rendered.push_back(type + " " + seed);
    orders.push_back(order);
    if (type == fails) return RenderOutcome{{}, "exited with code 5: it broke", 0.1};
    RenderOutcome outcome;
    outcome.wall_seconds = 1;
    outcome.figures = {{"seconds", {{"load", 0.25}, {"prepare", 0.0}}},
                       {"passes", std::max(1, number(order, "stop.passes"))}};
    std::vector<double> budgets = order.snapshot_seconds;
    budgets.insert(budgets.end(), order.snapshot_passes.begin(), order.snapshot_passes.end());
    for (std::size_t i = 0; i < budgets.size(); ++i) {
      const auto file = order.out / fmt::format("image.snapshot-{}.exr", i + 1);
      write(file, order, type, seed, budgets[i]);
      outcome.figures["snapshots"].push_back({{"exr", file.string()},
                                              {"budget", budgets[i]},
                                              {"seconds", budgets[i]},
                                              {"cpu_seconds", 1.5 * budgets[i]},
                                              {"passes", 10 * (i + 1)},
                                              {"photon_paths", 1000 * (i + 1)},
                                              {"rays", 5000 * (i + 1)},
                                              {"peak_bytes", 1 << 20}});
    }
    if (budgets.empty()) write(order.out / "image.exr", order, type, seed, 100.0 * number(order, "stop.passes"));
    std::ofstream(order.out / "image.json") << outcome.figures.dump();
    return outcome;
  }

  Result<nlohmann::json> plan(const std::filesystem::path& job, const std::vector<std::string>&) override {
    if (plan_document.is_null()) return fail(ErrorKind::kInvalidInput, job.string() + ": broken");
    return plan_document;
  }

 private:
  static std::string value(const RenderOrder& order, const std::string& key) {
    std::string found;
    for (const std::string& set : order.set) {
      if (set.starts_with(key + "=")) found = set.substr(key.size() + 1);
    }
    return found;
  }
  static int number(const RenderOrder& order, const std::string& key) {
    const std::string text = value(order, key);
    return text.empty() ? 0 : std::stoi(text);
  }
  void write(const std::filesystem::path& file, const RenderOrder& order, const std::string& type,
             const std::string& seed, double budget) const {
    std::mt19937_64 random(std::hash<std::string>()(type + seed));
    const float scale = std::ranges::find(order.set, worse) == order.set.end() ? 0.1f : 0.2f;
    std::normal_distribution<float> noise(0.5f, scale / static_cast<float>(std::sqrt(budget)));
    const int width = std::max(1, number(order, "image.width"));
    const int height = std::max(1, number(order, "image.height"));
    LayeredImage image{width, height, {{"", {"R", "G", "B"}, {}}}, {}};
    for (int i = 0; i < 3 * width * height; ++i) image.layers[0].data.push_back(noise(random));
    if (type == broken) {
      image.layers[0].data[0] = std::numeric_limits<float>::quiet_NaN();
      image.layers[0].data[5] = -1;
    }
    [[maybe_unused]] const auto written = write_exr(file, image);
  }
};

/// A job over an empty scene, and a suite of two methods and two seeds on it.
inline std::filesystem::path write_suite(const std::filesystem::path& folder, const std::string& more = "",
                                         const std::string& photons = "1000") {
  std::ofstream(folder / "empty.gltf") << R"({"asset":{"version":"2.0"}})";
  std::ofstream(folder / "box.toml") << "spec_version = 1\n[job]\nname = \"box\"\n[scene]\nfile = \"empty.gltf\"\n";
  std::ofstream(folder / "suite.toml") << R"(bench_version = 1
name = "fake <suite>"
[run]
seconds = [1, 2, 4]
repetitions = 3
width = 12
height = 8
[reference]
passes = 4
[[scene]]
job = "box.toml"
[[method]]
type = "path"
[[method]]
type = "sppm"
set = ["integrator.photons=)" << photons
                                       << "\"]\n"
                                       << more;
  return folder / "suite.toml";
}

}  // namespace pf::bench
