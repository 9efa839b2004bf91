#pragma once

#include <cstdint>
#include <iosfwd>
#include <string>

#include "common/base/clock.h"
#include "common/base/status_line.h"

namespace pf {

/// How far a job is. Counters run from the start of the process; `passes_done` includes those of a
/// checkpoint.
struct Progress {
  std::int64_t passes_done = 0;
  std::int64_t passes_total = 0;  ///< 0: not bounded by passes
  double seconds_limit = 0;       ///< of this process; 0: not bounded by time
  double error = 0;               ///< estimated relative error; 0: not known
  double error_target = 0;        ///< 0: not bounded by error
  std::uint64_t rays = 0;
  std::uint64_t photons = 0;  ///< paths started at lights
};

/// Shows progress to a person: one line that is drawn again and again on a terminal, a line now and then
/// elsewhere. The caller passes standard error, never standard output. Called from one thread.
class ProgressReporter {
 public:
  using Style = StatusLine::Style;
  /// `columns`: width of the terminal; a bar never wraps. Time starts here.
  ProgressReporter(const Clock& clock, std::ostream& out, Style style, int columns = 80);

  /// Call as often as you like; the first call fixes what a checkpoint had already done.
  void update(const Progress& progress);
  /// Writes the last line, also when nothing was written before.
  void finish(const Progress& progress);

 private:
  [[nodiscard]] std::string line(const Progress& progress, double elapsed) const;

  const Clock& clock_;
  StatusLine shown_;
  double start_;
  std::int64_t passes_at_start_ = -1;
};

/// Share of the job that is done, in [0,1]: the largest among passes, time and error, since whichever comes
/// first stops it. `elapsed`: seconds. An error falls with the square root of the work at best, and is taken
/// to.
[[nodiscard]] double fraction_done(const Progress& progress, double elapsed);

}  // namespace pf
