#include "coordinator/retention.h"

#include <algorithm>
#include <tuple>

#include <fmt/format.h>

namespace pf {
namespace {

constexpr double kDayMs = 86400e3;

}  // namespace

std::vector<Expiry> what_expires(const RetentionPolicy& policy, std::vector<KeptFiles> kept, std::int64_t now_unix_ms) {
  std::sort(kept.begin(), kept.end(), [](const KeptFiles& a, const KeptFiles& b) {
    return std::tie(a.ended_unix_ms, a.job) < std::tie(b.ended_unix_ms, b.job);
  });
  std::vector<Expiry> expired;
  std::uint64_t bytes = 0;
  const auto judge = [&](const KeptFiles& files, bool results, double days) {
    std::uint64_t KeptFiles::*const part = results ? &KeptFiles::result_bytes : &KeptFiles::checkpoint_bytes;
    if (files.*part == 0) return;
    if (days > 0 && static_cast<double>(now_unix_ms - files.ended_unix_ms) >= days * kDayMs) {
      expired.push_back({files.job, results, fmt::format("it is kept for {:g} days", days)});
    } else {
      bytes += files.*part;
    }
  };
  for (const KeptFiles& files : kept) {
    judge(files, false, policy.checkpoint_days);
    judge(files, true, policy.result_days);
  }
  if (policy.bytes == 0) return expired;
  const auto gone = [&expired, by_age = expired.size()](const KeptFiles& files, bool results) {
    return std::any_of(expired.begin(), expired.begin() + static_cast<std::ptrdiff_t>(by_age),
                       [&](const Expiry& e) { return e.job == files.job && e.results == results; });
  };
  for (const bool results : {false, true}) {
    for (const KeptFiles& files : kept) {
      const std::uint64_t size = results ? files.result_bytes : files.checkpoint_bytes;
      if (bytes <= policy.bytes || size == 0 || gone(files, results)) continue;
      expired.push_back({files.job, results, fmt::format("ended jobs' files were more than {} bytes", policy.bytes)});
      bytes -= size;
    }
  }
  return expired;
}

}  // namespace pf
