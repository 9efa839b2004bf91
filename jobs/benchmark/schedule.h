#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/spec/job_spec.h"
#include "jobs/benchmark/runner.h"
#include "jobs/benchmark/suite.h"
#include "jobs/submission.h"

namespace pf::bench {

/// A scene of a suite, found and hashed.
struct Scene {
  std::string name;
  std::filesystem::path job;
  std::vector<std::string> set;  ///< the suite's keys and size
  std::string hash;              ///< of all files that rendering opens
  std::string error;             ///< why it cannot be rendered; empty: it can
  ReferenceSettings reference;
  double exposure = 0;  ///< stops, of pictures
};

/// Loads every job file and hashes what it needs. glTF files are copied, with the template that they go into, below
/// `out`/scenes. A scene whose files are missing or broken is left with its error. Errors: kInvalidSpec for job files
/// and keys.
[[nodiscard]] Result<std::vector<Scene>> prepare_scenes(const Suite& suite, const std::filesystem::path& out);

/// One render: a method on a scene with a seed, over all budgets.
struct Run {
  std::string id;  ///< names everything that its result depends on
  std::size_t scene = 0, method = 0;
  int repetition = 0;
  std::uint64_t seed = 0;
  RenderOrder order;
};

/// Copies all files that a job opens into a folder, with the job beside them. Returns that job file, and in `files`
/// what was copied. Errors: kInvalidInput, kInternal.
[[nodiscard]] Result<std::filesystem::path> lay_out(const JobSpec& spec, const std::filesystem::path& folder,
                                                    std::vector<SubmittedFile>& files);

/// The run of a method on a scene with a seed over the suite's budgets; its folder lies below `out`/runs. `build` names
/// the renderer. Errors: kInvalidSpec.
[[nodiscard]] Result<Run> make_run(const Suite& suite, const Scene& scene, const MethodEntry& method,
                                   std::uint64_t seed, const std::string& build, const std::filesystem::path& out);

/// Every run of a suite, in the order in which they are made: all of the first repetition, shuffled, then all of the
/// second, shuffled anew, so that a drift of the machine hits all methods alike. `build`: names the renderer. Errors:
/// kInvalidSpec for keys of a method.
[[nodiscard]] Result<std::vector<Run>> make_schedule(const Suite& suite, const std::vector<Scene>& scenes,
                                                     const std::string& build, const std::filesystem::path& out);

/// The canonical spec of a job with these overrides, without its name: what an image and its cost depend on.
[[nodiscard]] Result<std::string> identity_of_job(const std::filesystem::path& job,
                                                  const std::vector<std::string>& set);

}  // namespace pf::bench
