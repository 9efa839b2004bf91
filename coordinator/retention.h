#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace pf {

/// How long what jobs leave is kept after they have ended. 0: for ever, without bound.
struct RetentionPolicy {
  double result_days = 0;      ///< images and figures
  double checkpoint_days = 0;  ///< without its checkpoint a job cannot be extended
  std::uint64_t bytes = 0;     ///< of both together, over all ended jobs
  [[nodiscard]] bool keeps_all() const { return result_days <= 0 && checkpoint_days <= 0 && bytes == 0; }
};

/// What an ended job has on disk.
struct KeptFiles {
  std::string job;
  std::int64_t ended_unix_ms = 0;
  std::uint64_t result_bytes = 0, checkpoint_bytes = 0;  ///< 0: none
};

struct Expiry {
  std::string job;
  bool results = false;  ///< else its checkpoint
  std::string why;
};

/// Beyond the bound on bytes, checkpoints of the jobs that ended first go first, then results in the same order.
[[nodiscard]] std::vector<Expiry> what_expires(const RetentionPolicy& policy, std::vector<KeptFiles> kept,
                                               std::int64_t now_unix_ms);

}  // namespace pf
