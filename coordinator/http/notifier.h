#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "coordinator/job_service.h"

namespace pf {

/// One message about a job that has ended.
struct Notice {
  std::string id;    ///< of the message: the job and when it ended; the same in every attempt
  std::string body;  ///< JSON
};

/// Which jobs' ends somebody still has to be told of, and when to try next: kept in a file, so that a restart
/// loses none. A message may arrive twice (the process died right after it), never not at all while attempts
/// last. Sends nothing itself; used from one thread.
class Notifier {
 public:
  static constexpr int kMostAttempts = 14;            ///< over about eight hours
  static constexpr std::int64_t kFirstPause = 5'000;  ///< ms; doubles up to an hour
  static constexpr std::int64_t kLongestPause = 3'600'000;

  /// Jobs that ended before the file was made are not told of. Errors: kInvalidInput for a broken file,
  /// kInternal.
  [[nodiscard]] static Result<Notifier> open(std::filesystem::path file, std::function<std::int64_t()> unix_ms);

  /// Notes the jobs that have ended since the last look.
  [[nodiscard]] Result<void> look(const std::vector<JobView>& jobs);
  /// What is to be sent now; empty: nothing.
  [[nodiscard]] std::optional<Notice> due() const;
  /// How an attempt went. False: it was the last one, and the message is given up.
  [[nodiscard]] Result<bool> tried(const std::string& id, bool arrived);
  [[nodiscard]] std::size_t pending() const { return pending_.size(); }

 private:
  struct Pending {
    std::string body;
    int attempts = 0;
    std::int64_t next_unix_ms = 0;
  };
  Notifier(std::filesystem::path file, std::function<std::int64_t()> unix_ms)
      : file_(std::move(file)), unix_ms_(std::move(unix_ms)) {}
  [[nodiscard]] Result<void> load();
  [[nodiscard]] Result<void> save() const;

  std::filesystem::path file_;
  std::function<std::int64_t()> unix_ms_;
  std::int64_t since_ = 0;
  std::map<std::string, std::int64_t> noted_;  ///< job -> the end that was noted last
  std::map<std::string, Pending> pending_;     ///< by the message's id
};

/// `t=SECONDS,v1=HEX`: HMAC-SHA256 under `secret` of `SECONDS.BODY`. The time is part of it, so that a
/// receiver can refuse what somebody recorded and sends again later.
[[nodiscard]] std::string webhook_signature(std::string_view secret, std::int64_t unix_seconds, std::string_view body);

}  // namespace pf
