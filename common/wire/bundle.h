#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/spec/job_spec.h"
#include "common/wire/blob_store.h"

namespace pf {

/// A file that a job needs: its path relative to the job's folder, and where it lies now.
struct BundleFile {
  std::string path;
  std::filesystem::path source;
};

/// A job's files as the service knows them: path in the job's folder and content.
using FileList = std::vector<std::pair<std::string, BlobId>>;
/// `[{"path", "sha256", "bytes"}]`, as it stands in the metadata of an image.
[[nodiscard]] std::string file_list_json(const FileList& files);
/// Errors: kInvalidInput, also for paths that lead out of a folder.
[[nodiscard]] Result<FileList> parse_file_list(std::string_view json);
/// The files that a bundle's manifest lists. Errors: kInvalidInput.
[[nodiscard]] Result<FileList> files_of_bundle(std::string_view manifest);
/// The files of a job with their hashes. Errors: those of files_of_job and of reading.
[[nodiscard]] Result<FileList> hashed_files_of_job(const JobSpec& spec);

/// Every file that rendering the job opens: scene, its buffers and images (URIs of the glTF's JSON,
/// percent-decoded; data URIs and absent optional ones apart), environment. Reads JSON only, decodes nothing.
/// Errors: kInvalidInput, naming the file and URI: missing, not a regular file, absolute, with a scheme, or
/// outside the job's folder (also through a link).
[[nodiscard]] Result<std::vector<BundleFile>> files_of_job(const JobSpec& spec);

/// The bundle's manifest (wire Bundle, serialised): canonical spec and the files' paths and hashes, ascending
/// by path.
[[nodiscard]] Result<std::string> make_bundle(const JobSpec& spec,
                                              const std::vector<std::pair<std::string, BlobId>>& files);

/// Lays a bundle's files out below `folder` (hard links to the store's blobs where possible, else copies), so
/// that relative paths work and nothing else is there: `folder` must be empty or absent. All blobs must be in
/// the store. Returns the job, its folder set to `folder`. Errors: kInvalidInput and kInvalidSpec for the
/// bundle, before anything is written; kInternal for the disk.
[[nodiscard]] Result<JobSpec> unpack_bundle(std::string_view manifest, const BlobStore& store,
                                            const std::filesystem::path& folder);

}  // namespace pf
