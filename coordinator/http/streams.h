#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>

#include "coordinator/http/message.h"
#include "coordinator/job_service.h"

namespace pf {

/// Views of jobs as lines of JSON, made once for all clients that watch a job. For any thread.
class JobTexts {
 public:
  explicit JobTexts(JobService& service) : service_(service) {}
  struct Text {
    std::uint64_t version = 0;  ///< of the service, when it was asked
    std::string json;
    bool ended = false;
  };
  /// The job as it was at `version` or later.
  [[nodiscard]] Result<std::shared_ptr<const Text>> get(const std::string& id, std::uint64_t version);

 private:
  JobService& service_;
  std::mutex mutex_;
  std::map<std::string, std::shared_ptr<const Text>> texts_;
};

/// Server-sent events (WHATWG HTML, 9.2): an event `job` with the JobView whenever it changed, at most two a
/// second, and a comment line after `heartbeat_seconds` of silence. Ends after the event that shows the job
/// ended, or when `stop` is requested.
[[nodiscard]] NextPiece job_events(JobService& service, JobTexts& texts, std::string id, double heartbeat_seconds,
                                   std::stop_token stop);

/// Log entries after number `after`, a line of JSON each. Ends with the last one; if `follow`, with the last
/// one of a job that has ended, or when `stop` is requested, and shows by empty lines that it lives.
[[nodiscard]] NextPiece log_lines(JobService& service, std::string id, std::uint64_t after, bool follow,
                                  double heartbeat_seconds, std::stop_token stop);

}  // namespace pf
