#pragma once

#include <filesystem>
#include <memory>
#include <thread>

#include "common/base/log.h"
#include "common/base/result.h"
#include "coordinator/config.h"
#include "coordinator/http/notifier.h"

namespace pf {

/// Tells the operator's webhook of each job that has ended, from a thread of its own: the farm never waits
/// for it. Where it goes is in the farm's configuration alone: were it in a job, whoever may submit could let
/// the coordinator connect to what only the coordinator reaches. Redirects are not followed, and nothing of a
/// reply but its status is used.
class Webhook {
 public:
  /// Errors: kUsage for a secret that is missing, too short or that others may read; those of Notifier::open.
  [[nodiscard]] static Result<std::unique_ptr<Webhook>> start(const CoordinatorConfig::Notify& config,
                                                              const std::filesystem::path& state, JobService& service,
                                                              const Log& log);

 private:
  Webhook(CoordinatorConfig::Notify config, std::string secret, Notifier notifier, JobService& service, const Log& log);
  void run(const std::stop_token& stop);
  void deliver();

  const CoordinatorConfig::Notify config_;
  const std::string secret_;
  Notifier notifier_;
  JobService& service_;
  const Log& log_;
  std::jthread thread_;  ///< last: it uses the others
};

}  // namespace pf
