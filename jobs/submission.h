#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/base/result.h"
#include "common/spec/job_spec.h"
#include "common/wire/blob_store.h"
#include "jobs/service_client.h"

namespace pf {

struct SubmittedFile {
  std::string path;  ///< in the job's folder
  std::filesystem::path source;
  BlobId id;
};

/// Every file of a job with its hash. Errors: kInvalidInput.
[[nodiscard]] Result<std::vector<SubmittedFile>> hash_files(const JobSpec& spec);

/// The body of POST /v1/jobs.
[[nodiscard]] nlohmann::json submission_body(const JobSpec& spec, const std::vector<SubmittedFile>& files);

/// Uploads what the service lacks.
[[nodiscard]] Result<void> upload_files(ServiceClient& client, const std::vector<SubmittedFile>& files);

/// Posts a job whose files the service has all. Errors: kInvalidInput, naming those that it lacks.
[[nodiscard]] Result<nlohmann::json> submit_known_files(ServiceClient& client, const JobSpec& spec,
                                                        const std::vector<SubmittedFile>& files);

inline constexpr std::string_view kJobsPath = "/v1/jobs";
/// Uploads what the service lacks, then posts the job to `path`; once, however often the service goes away
/// meanwhile. Returns the job. Errors: those of ServiceClient::ask; kInvalidInput for a file that changed
/// meanwhile.
[[nodiscard]] Result<nlohmann::json> submit_job(ServiceClient& client, const JobSpec& spec,
                                                const std::vector<SubmittedFile>& files,
                                                const std::string& path = std::string(kJobsPath));

}  // namespace pf
