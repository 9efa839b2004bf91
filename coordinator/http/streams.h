#pragma once

#include <cstdint>
#include <stop_token>
#include <string>

#include "coordinator/http/message.h"
#include "coordinator/job_service.h"

namespace pf {

/// Server-sent events (WHATWG HTML, 9.2): an event `job` with the JobView whenever it changed, at most ten a
/// second, and a comment line after `heartbeat_seconds` of silence. Ends after the event that shows the job
/// ended, or when `stop` is requested.
[[nodiscard]] NextPiece job_events(JobService& service, std::string id, double heartbeat_seconds,
                                   std::stop_token stop);

/// Log entries after number `after`, a line of JSON each. Ends with the last one; if `follow`, with the last
/// one of a job that has ended, or when `stop` is requested, and shows by empty lines that it lives.
[[nodiscard]] NextPiece log_lines(JobService& service, std::string id, std::uint64_t after, bool follow,
                                  double heartbeat_seconds, std::stop_token stop);

}  // namespace pf
