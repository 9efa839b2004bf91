#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/film/film.h"
#include "common/film/statistics.h"
#include "common/spec/job_spec.h"

namespace pf {

/// Something slow that a session wants done, on another thread.
struct Work {
  enum class Kind { kPrepare, kTrace };
  Kind kind = Kind::kTrace;
  std::string bundle;  ///< SHA-256 of the bundle: names the scene
  JobSpec spec;        ///< its folder holds the bundle's files
  std::uint64_t first_sub_pass = 0, sub_passes = 0;
  std::shared_ptr<const std::vector<ProgressivePixel>> state;
  std::shared_ptr<Statistics> sums;  ///< to add to; nobody else touches them until the work is done
};

/// What a PREPARE finds out.
struct PreparedScene {
  FilmOptions film;
  std::vector<ProgressivePixel> radii;
  std::string scene_hash, plan_line;
  std::vector<std::string> warnings;
};

struct WorkDone {
  Result<void> status;
  double seconds = 0;  ///< of tracing or preparing, loading apart
  std::unique_ptr<PreparedScene> prepared;
};

/// Does one piece of work at a time; the owner hands its WorkDone to Session::on_done.
class Executor {
 public:
  virtual ~Executor() = default;
  virtual void start(Work work) = 0;
};

}  // namespace pf
