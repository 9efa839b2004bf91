#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "common/base/result.h"
#include "common/spec/job_spec.h"
#include "worker/photon/irradiance_file.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// The cache file of a job (`cache.file`): what it held, and writing it back. Does nothing for a job that
/// names none.
///
/// A file of other options is not used and written anew. One that cannot be read, or is none of ours, is left
/// alone and reported by error(): the cache is then built from nothing and not kept.
class IrradianceStore {
 public:
  /// `parts`: of the scene; needed for a job that names a file.
  IrradianceStore(const JobSpec& spec, const Camera& camera, std::vector<ScenePart> parts);

  /// Whether records are kept from one run to the next.
  [[nodiscard]] bool keeps() const { return keeps_; }
  [[nodiscard]] const std::optional<Error>& error() const { return error_; }
  /// Of the gather rays' random numbers: that of the file, else the job's.
  [[nodiscard]] std::uint64_t seed() const { return content_.seed; }
  /// What changed in the scene since the file was written.
  [[nodiscard]] const SceneChange& change() const { return change_; }
  /// Whether records for this view and these options lie in the file already.
  [[nodiscard]] bool holds_view() const;
  [[nodiscard]] IrradianceFile& content() { return content_; }
  /// Writes what content() holds, with the scene's parts and this view.
  void write();

 private:
  [[nodiscard]] Result<void> load(const JobSpec& spec);

  std::filesystem::path file_;
  IrradianceFile content_;
  std::vector<ScenePart> parts_;
  SceneChange change_;
  std::uint64_t view_ = 0;
  bool keeps_ = false;
  std::optional<Error> error_;
};

}  // namespace pf
