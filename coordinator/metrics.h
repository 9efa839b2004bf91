#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "coordinator/job_service.h"

namespace pf {

/// How often something took how long, in buckets of given upper bounds [s]. May be used from any thread.
class Histogram {
 public:
  explicit Histogram(std::vector<double> bounds) : bounds_(std::move(bounds)), counts_(bounds_.size() + 1) {}
  void observe(double seconds);
  /// Appends its lines in Prometheus' text format; `labels`: `a="b",` or empty.
  void write(std::string& text, std::string_view name, std::string_view labels) const;

 private:
  std::vector<double> bounds_;
  mutable std::mutex mutex_;
  std::vector<std::uint64_t> counts_;  ///< of each bucket alone; the last one has no bound
  double sum_ = 0;
};

/// What a coordinator has counted since it was started. May be used from any thread.
class Metrics {
 public:
  using Counter = std::atomic<std::uint64_t>;
  Counter rays{0}, photon_paths{0}, sub_passes{0}, rounds{0}, units{0}, retries{0}, quarantines{0}, bytes_received{0},
      alarms{0};                               ///< alarms: two different results of one unit
  std::atomic<std::uint64_t> queued_units{0};  ///< published, not yet with a worker as far as is known
  Histogram unit_seconds{{0.1, 0.25, 0.5, 1, 2.5, 5, 10, 25, 50, 100, 250, 600}};
  Histogram merge_seconds{{0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5}};

  /// A request of the API that was answered; streams and files count up to the begin of their bodies.
  void request(std::string_view method, std::string_view route, int status, double seconds);
  /// Prometheus' text format 0.0.4: what was counted, and jobs and workers as they are now.
  [[nodiscard]] std::string text(const std::vector<JobView>& jobs, const std::vector<WorkerView>& workers) const;

 private:
  mutable std::mutex mutex_;
  std::map<std::string, Histogram> request_seconds_;  ///< by labels: `method="GET",route="/v1/jobs/{}",`
  std::map<std::string, std::uint64_t> requests_;     ///< the same with `code`
};

}  // namespace pf
