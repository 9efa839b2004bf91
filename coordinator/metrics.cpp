// Prometheus' text format is a page long, and Debian's library for it brings two web servers along: so it is
// written here. https://prometheus.io/docs/instrumenting/exposition_formats/

#include "coordinator/metrics.h"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "build_id.h"

namespace pf {
namespace {

constexpr std::array<std::string_view, 9> kWorkerStates = {"idle",    "loading",  "tracing", "sending",    "draining",
                                                           "drained", "disabled", "lost",    "quarantined"};

void head(std::string& text, std::string_view name, std::string_view type, std::string_view help) {
  text += fmt::format("# HELP photonfarm_{0} {2}\n# TYPE photonfarm_{0} {1}\n", name, type, help);
}

void single(std::string& text, std::string_view name, std::string_view type, std::string_view help, double value) {
  head(text, name, type, help);
  text += fmt::format("photonfarm_{} {}\n", name, value);
}

void counter(std::string& text, std::string_view name, std::string_view help, const Metrics::Counter& value) {
  single(text, name, "counter", help, static_cast<double>(value.load()));
}

void by_state(std::string& text, std::string_view name, std::string_view help,
              const std::map<std::string, int>& counts) {
  head(text, name, "gauge", help);
  for (const auto& [state, count] : counts)
    text += fmt::format("photonfarm_{}{{state=\"{}\"}} {}\n", name, state, count);
}

void write_jobs(std::string& text, const std::vector<JobView>& jobs) {
  std::map<std::string, int> states;
  for (const JobState state : all_job_states()) states[std::string(to_string(state))] = 0;
  double rays = 0, passes = 0;
  for (const JobView& job : jobs) {
    ++states[std::string(to_string(job.state))];
    if (has_ended(job.state)) continue;
    rays += job.rays_per_second;
    passes += job.passes_per_second;
  }
  by_state(text, "jobs", "Jobs by state.", states);
  single(text, "rays_per_second", "gauge", "Rays traced per second by the jobs that run, as their views say.", rays);
  single(text, "passes_per_second", "gauge", "Sub-passes per second of the jobs that run.", passes);
}

void write_workers(std::string& text, const std::vector<WorkerView>& workers) {
  std::map<std::string, int> states;
  for (const std::string_view state : kWorkerStates) states[std::string(state)] = 0;
  int held = 0;
  for (const WorkerView& worker : workers) {
    ++states[worker.state];
    held += worker.units_held;
  }
  by_state(text, "workers", "Workers by state.", states);
  single(text, "units_held", "gauge", "Work units that workers have in hand.", held);
}

}  // namespace

void Histogram::observe(double seconds) {
  const auto bucket =
      static_cast<std::size_t>(std::lower_bound(bounds_.begin(), bounds_.end(), seconds) - bounds_.begin());
  const std::lock_guard lock(mutex_);
  ++counts_[bucket];
  sum_ += seconds;
}

void Histogram::write(std::string& text, std::string_view name, std::string_view labels) const {
  const std::lock_guard lock(mutex_);
  const std::string own = labels.empty() ? std::string() : fmt::format("{{{}}}", labels.substr(0, labels.size() - 1));
  std::uint64_t below = 0;
  for (std::size_t i = 0; i < counts_.size(); ++i) {
    below += counts_[i];
    const std::string bound = i < bounds_.size() ? fmt::format("{}", bounds_[i]) : "+Inf";
    text += fmt::format("photonfarm_{}_bucket{{{}le=\"{}\"}} {}\n", name, labels, bound, below);
  }
  text += fmt::format("photonfarm_{0}_sum{1} {2}\nphotonfarm_{0}_count{1} {3}\n", name, own, sum_, below);
}

void Metrics::request(std::string_view method, std::string_view route, int status, double seconds) {
  const std::string labels = fmt::format("method=\"{}\",route=\"{}\",", method, route);
  const std::lock_guard lock(mutex_);
  auto found = request_seconds_.find(labels);
  if (found == request_seconds_.end()) {
    found = request_seconds_
                .try_emplace(labels, std::vector<double>{0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 5})
                .first;
  }
  found->second.observe(seconds);
  ++requests_[fmt::format("{}code=\"{}\"", labels, status)];
}

std::string Metrics::text(const std::vector<JobView>& jobs, const std::vector<WorkerView>& workers) const {
  std::string text;
  head(text, "build_info", "gauge", "The coordinator's version and build.");
  text += fmt::format("photonfarm_build_info{{version=\"{}\",build_id=\"{}\"}} 1\n", kVersion, kBuildId);
  counter(text, "rays_total", "Rays traced in results that count.", rays);
  counter(text, "photon_paths_total", "Photon paths in results that count.", photon_paths);
  counter(text, "sub_passes_total", "Sub-passes that count.", sub_passes);
  counter(text, "rounds_total", "Rounds that were closed.", rounds);
  counter(text, "units_total", "Work units that count.", units);
  counter(text, "unit_retries_total", "Attempts at work units beyond the first.", retries);
  counter(text, "quarantines_total", "Workers put in quarantine.", quarantines);
  counter(text, "unit_alarms_total", "Units of which two workers returned different sums.", alarms);
  counter(text, "received_bytes_total", "Bytes of results that were taken in.", bytes_received);
  single(text, "units_queued", "gauge", "Work units in the queue, not yet with a worker.",
         static_cast<double>(queued_units.load()));
  write_jobs(text, jobs);
  write_workers(text, workers);
  head(text, "unit_seconds", "histogram", "Seconds of tracing of a work unit.");
  unit_seconds.write(text, "unit_seconds", "");
  head(text, "merge_seconds", "histogram", "Seconds that taking a result in cost the coordinator.");
  merge_seconds.write(text, "merge_seconds", "");
  const std::lock_guard lock(mutex_);
  head(text, "http_request_seconds", "histogram",
       "Seconds until a request was answered; of streams, until they began.");
  for (const auto& [labels, histogram] : request_seconds_) histogram.write(text, "http_request_seconds", labels);
  head(text, "http_requests_total", "counter", "Requests by status code.");
  for (const auto& [labels, count] : requests_)
    text += fmt::format("photonfarm_http_requests_total{{{}}} {}\n", labels, count);
  return text;
}

}  // namespace pf
