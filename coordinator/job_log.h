#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "coordinator/job_service.h"

namespace pf {

/// A job's log: the latest entries in memory, all of them as lines of JSON in `log.jsonl` of the job's folder. A full
/// disk loses lines of the file and nothing else.
class JobLog {
 public:
  JobLog() = default;
  /// Goes on with the file's numbers.
  explicit JobLog(const std::filesystem::path& folder);

  void add(std::int64_t unix_ms, std::string_view level, std::string_view source, std::string_view text);
  /// Entries after `after`, at most 1000, oldest first.
  [[nodiscard]] std::vector<LogEntry> after(std::uint64_t after) const;

 private:
  std::filesystem::path file_;
  std::deque<LogEntry> entries_;
  std::uint64_t last_ = 0;
};

}  // namespace pf
