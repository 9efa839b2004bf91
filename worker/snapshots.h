#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/result.h"
#include "common/film/film.h"
#include "common/film/render_result.h"

namespace pf {

/// Budgets at which the image so far is written on the way; ascending. At most one of the two is used: seconds win.
struct SnapshotPlan {
  std::vector<double> seconds;       ///< as stop.seconds counts them
  std::vector<std::int64_t> passes;  ///< as stop.passes counts them
  [[nodiscard]] bool empty() const { return seconds.empty() && passes.empty(); }
};

/// Writes the images of a SnapshotPlan while a job renders. What `stop.seconds` or `stop.passes` of a budget would have
/// given is what the snapshot holds, except that none is written before every pixel has a sample. One run then serves
/// all budgets.
class Snapshots {
 public:
  Snapshots(SnapshotPlan plan, std::filesystem::path folder, std::string name, const Clock& clock)
      : plan_(std::move(plan)), folder_(std::move(folder)), name_(std::move(name)), clock_(clock) {}

  [[nodiscard]] bool wanted() const { return !plan_.empty(); }
  /// Whether every pixel has a sample: methods that render in tiles leave black ones until then.
  [[nodiscard]] static bool whole(const Film& film);
  /// Call after every sub-pass, and once with `last` when the render has ended. `seconds`: since the start, what
  /// snapshots took left out; `next`: when one more sub-pass and writing would be done. Returns the seconds that
  /// writing took, for the caller to take off its clock. Errors: kInternal.
  [[nodiscard]] Result<double> take(const Film& film, double seconds, double next, bool last);
  [[nodiscard]] const std::vector<RenderSnapshot>& taken() const { return taken_; }

 private:
  [[nodiscard]] std::size_t budgets() const { return std::max(plan_.seconds.size(), plan_.passes.size()); }
  [[nodiscard]] bool reached(std::size_t budget, const Film& film, double next) const;
  [[nodiscard]] Result<RenderSnapshot> write(const Film& film, double seconds);

  SnapshotPlan plan_;
  std::filesystem::path folder_;
  std::string name_;
  const Clock& clock_;
  ProcessorClock processor_;
  std::vector<RenderSnapshot> taken_;
  std::size_t next_ = 0;
  double cpu_spent_ = 0;  ///< on writing
};

}  // namespace pf
