#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "common/base/result.h"
#include "common/film/image.h"
#include "common/spec/job_spec.h"
#include "common/wire/bundle.h"
#include "jobs/service_client.h"

namespace pf {

/// What an image says about how it came to be.
struct ImageOrigin {
  JobSpec spec;    ///< stops after the image's own passes, so that it gives the same bits again
  FileList files;  ///< of the scene; empty when the image does not say
  std::string build_id, scene_hash, state_chain;
  std::string image_hash;  ///< of the pixels that the file has now
  LayeredImage image;
};

/// Reads it from an EXR of ours. Errors: kInvalidInput for any other file.
[[nodiscard]] Result<ImageOrigin> read_origin(const std::filesystem::path& exr);

/// Sets the job's folder to `scene` and checks that its files are those of the image. Errors: kInvalidInput,
/// naming the first one that differs.
[[nodiscard]] Result<void> use_scene_folder(ImageOrigin& origin, const std::filesystem::path& scene);

/// Fetches the scene's files from the service into `folder` and makes that the job's folder. Errors:
/// kInvalidInput for what the service does not have any more.
[[nodiscard]] Result<void> fetch_scene(ServiceClient& client, ImageOrigin& origin, const std::filesystem::path& folder);

/// Copies the files of the job to `folder`, writes its spec there as job.json, and returns that file's path.
[[nodiscard]] Result<std::filesystem::path> lay_out_job(const ImageOrigin& origin, const std::filesystem::path& folder);

}  // namespace pf
