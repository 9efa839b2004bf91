#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/film/film.h"
#include "common/spec/job_spec.h"
#include "tests/support/statistics.h"
#include "worker/integrators/integrator.h"
#include "worker/scene/scene.h"

namespace pf::test {

/// The algorithm of spec.integrator, which names one, seen by the scene's first camera; its photons are guided only
/// where the job says so outright.
[[nodiscard]] std::unique_ptr<const Integrator> make_integrator(const Scene& scene, const JobSpec& spec);

/// Renders so many passes over the image, round by round, on the threads of the calling arena.
[[nodiscard]] Film render(const Integrator& integrator, std::uint64_t passes);
[[nodiscard]] Film render(const Scene& scene, const JobSpec& spec, std::uint64_t passes);

/// A layer of the film's image ("": beauty), RGB by pixel.
[[nodiscard]] std::vector<Rgb> layer_of(const Film& film, std::string_view layer = "");

/// The same picture by several seeds: what confidence intervals come from. Fails the test on faults.
class Renders {
 public:
  Renders(const Scene& scene, const JobSpec& spec, std::uint64_t sub_passes, int runs, std::string_view layer = "");

  /// Mean over channels of the mean over the image.
  [[nodiscard]] Estimate mean() const;
  /// Mean over channels, pixel by pixel.
  [[nodiscard]] std::vector<Estimate> pixels() const;
  /// One channel of the mean over the image.
  [[nodiscard]] Estimate channel(int c) const;
  /// Mean of the pixels in every cell of a `columns` x `rows` grid of blocks.
  [[nodiscard]] std::vector<Estimate> blocks(int columns, int rows) const;

 private:
  int width_, height_;
  std::vector<std::vector<Rgb>> images_;
};

/// Calls `test` with a name and a job for every algorithm that is consistent, for SPPM in both modes.
template <typename F>
void for_each_algorithm(const JobSpec& base, F&& test) {
  JobSpec spec = base;
  spec.integrator.type = IntegratorType::kPath;
  test("path", spec);
  spec.integrator.type = IntegratorType::kSppm;
  spec.integrator.mode = ProgressiveMode::kShared;
  test("sppm shared", spec);
  spec.integrator.mode = ProgressiveMode::kIndependent;
  test("sppm independent", spec);
  spec.integrator.type = IntegratorType::kPpm;
  spec.integrator.mode = ProgressiveMode::kShared;
  test("ppm shared", spec);
}

}  // namespace pf::test
