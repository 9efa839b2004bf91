#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/base/result.h"
#include "jobs/service_client.h"

namespace pf {

// What the client commands do with jobs of a service. A job is the JSON that the service gives (JobView): its
// fields are read by the functions of job_text.h, and absent ones do no harm.

/// All jobs of the service, in this state if one is named, by time of submission; page by page.
[[nodiscard]] Result<nlohmann::json> list_jobs(ServiceClient& client, const std::string& state, bool patient);

/// The job that a person means: an id, a job's name (of several, the one submitted last) or the begin of one
/// id. Errors: kUsage, with the nearest name; kUnavailable.
[[nodiscard]] Result<nlohmann::json> find_job(ServiceClient& client, const std::string& what, bool patient);

/// Calls `show` with the job now and after each change until it has ended; returns it then. Goes on when the
/// service was away. Errors: kUnavailable, kInterrupted, kUsage when the service no longer knows it.
[[nodiscard]] Result<nlohmann::json> watch_job(ServiceClient& client, const std::string& id,
                                               const std::function<void(const nlohmann::json&)>& show);

/// Every work unit of a job that the service still knows (GET /v1/jobs/{id}/units), page by page.
[[nodiscard]] Result<nlohmann::json> all_units(ServiceClient& client, const std::string& id);

struct DownloadedFiles {
  std::filesystem::path exr, png, json;
};
/// Fetches the three files of a job to FOLDER/<name>.exr, .png and .json, byte for byte. A download that
/// broke off goes on where it was, in this process or in a later one. Errors: kInternal when the job has
/// none, or for the disk.
[[nodiscard]] Result<DownloadedFiles> download_job(ServiceClient& client, const nlohmann::json& job,
                                                   const std::filesystem::path& folder);

}  // namespace pf
