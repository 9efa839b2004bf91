#pragma once

#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

#include "common/base/result.h"
#include "coordinator/job_service.h"

namespace pf {

/// Field by field as in job_service.h; what is not known yet is null, infinite numbers too.
[[nodiscard]] nlohmann::json to_json(const JobView& job);
[[nodiscard]] nlohmann::json to_json(const WorkerView& worker);
[[nodiscard]] nlohmann::json to_json(const LogEntry& entry);
[[nodiscard]] nlohmann::json to_json(const UnitView& unit);
[[nodiscard]] nlohmann::json to_json(const ConvergencePoint& point);
/// One line; broken UTF-8 (it may come from a worker) is replaced, never an error.
[[nodiscard]] std::string json_line(const nlohmann::json& json);

/// A problem document (RFC 9457). `type` is the last word of `urn:photonfarm:problem:TYPE`. A detail that
/// begins with `file:line:column: ` gives a member `place`.
[[nodiscard]] std::string problem_json(int status, std::string_view type, std::string_view detail);
/// invalid-spec, invalid-input, not-found, ...
[[nodiscard]] std::string_view problem_type(ErrorKind kind);
/// `file:line:column` at the begin of a message; empty when there is none.
[[nodiscard]] std::string_view place_of(std::string_view message);
/// Reason phrase of the status codes in use.
[[nodiscard]] std::string_view status_title(int status);

/// What a client posts to /v1/jobs. Errors: kInvalidInput, naming the member. The spec's text keeps its place
/// in the body (what stands around it becomes blanks), so that places in its errors are places of the body.
enum class FilesMember { kNeeded, kOptional };
[[nodiscard]] Result<Submission> parse_submission(std::string body, FilesMember files = FilesMember::kNeeded);
/// {"discard": bool}
[[nodiscard]] Result<bool> parse_cancel(const std::string& body);
/// {"passes", "seconds", "error"}, at least one of them.
[[nodiscard]] Result<StopChange> parse_stops(const std::string& body);
/// {"priority", "max_workers"}, at least one of them.
[[nodiscard]] Result<JobChange> parse_change(const std::string& body);

}  // namespace pf
