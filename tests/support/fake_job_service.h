#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "coordinator/job_service.h"

namespace pf::test {

/// A coordinator without a farm: jobs are what the test makes them.
class FakeJobService final : public JobService {
 public:
  Result<JobView> submit(const Submission& submission) override {
    const std::lock_guard lock(mutex_);
    submissions.push_back(submission);
    if (submit_error) return tl::unexpected(*submit_error);
    for (const auto& [key, id] : keys_) {
      if (!key.empty() && key == submission.idempotency_key) return jobs_.at(id);
    }
    JobView job = new_job;
    job.id = new_job.id + (jobs_.empty() ? "" : "-" + std::to_string(jobs_.size()));
    job.submitted_unix_ms = 1'700'000'000'000 + static_cast<std::int64_t>(jobs_.size());
    keys_.emplace_back(submission.idempotency_key, job.id);
    jobs_[job.id] = job;
    changed();
    return job;
  }
  Result<Validation> validate(const Submission& submission) override {
    const std::lock_guard lock(mutex_);
    submissions.push_back(submission);
    if (submit_error) return tl::unexpected(*submit_error);
    return Validation{submission.spec_json, {"a warning"}};
  }
  Result<JobList> list(const JobFilter& filter) override {
    const std::lock_guard lock(mutex_);
    JobList all;
    for (const auto& [id, job] : jobs_) {
      if (filter.state && job.state != *filter.state) continue;
      if (!filter.name.empty() && job.name != filter.name) continue;
      if (!filter.before.empty() && id >= filter.before) continue;
      all.jobs.push_back(job);
    }
    if (all.jobs.size() > filter.limit)
      all.jobs.erase(all.jobs.begin(), all.jobs.end() - static_cast<long>(filter.limit));
    return all;
  }
  Result<JobView> show(const std::string& id) override {
    const std::lock_guard lock(mutex_);
    return find(id);
  }
  Result<JobView> act(const std::string& id, JobEvent verb, const std::string& by) override {
    const std::lock_guard lock(mutex_);
    auto job = find(id);
    if (!job) return job;
    const JobStep step = job_step(job->state, verb);
    if (step.kind == JobStep::Kind::kRefused) return fail(ErrorKind::kUnavailable, why_refused(job->state, verb));
    // What the farm does at once by itself is done here too.
    if (step.kind == JobStep::Kind::kMoves)
      jobs_[id].state = step.to == JobState::kFinishing ? JobState::kCancelled : step.to;
    jobs_[id].paused_by = jobs_[id].state == JobState::kPaused ? by : "";
    acts.push_back(std::string(to_string(verb)) + " " + id + " by " + by);
    changed();
    return jobs_[id];
  }
  Result<JobView> extend(const std::string& id, const StopChange& stops, const std::string& by) override {
    const std::lock_guard lock(mutex_);
    if (auto job = find(id); !job) return job;
    if (stops.passes) jobs_[id].passes_wanted = static_cast<std::uint64_t>(*stops.passes);
    if (stops.seconds) jobs_[id].stop_seconds = *stops.seconds;
    if (stops.error) jobs_[id].stop_error = *stops.error;
    ++jobs_[id].extended;
    acts.push_back("extend " + id + " by " + by);
    changed();
    return jobs_[id];
  }
  Result<JobView> change(const std::string& id, const JobChange& change, const std::string& by) override {
    const std::lock_guard lock(mutex_);
    if (auto job = find(id); !job) return job;
    if (change.priority) jobs_[id].priority = *change.priority;
    if (change.max_workers) jobs_[id].max_workers = *change.max_workers;
    acts.push_back("change " + id + " by " + by);
    changed();
    return jobs_[id];
  }
  Result<void> remove(const std::string& id, const std::string& by) override {
    const std::lock_guard lock(mutex_);
    auto job = find(id);
    if (!job) return tl::unexpected(job.error());
    if (!has_ended(job->state)) return fail(ErrorKind::kUnavailable, why_refused(job->state, JobEvent::kDelete));
    jobs_.erase(id);
    acts.push_back("delete " + id + " by " + by);
    changed();
    return {};
  }
  Result<UnitPage> units(const std::string& id, std::optional<std::uint64_t> after) override {
    const std::lock_guard lock(mutex_);
    if (auto job = find(id); !job) return tl::unexpected(job.error());
    UnitPage page;
    for (const UnitView& unit : all_units) {
      if (!after || unit.first > *after) page.units.push_back(unit);
    }
    return page;
  }
  Result<std::vector<ConvergencePoint>> convergence(const std::string& id) override {
    const std::lock_guard lock(mutex_);
    if (auto job = find(id); !job) return tl::unexpected(job.error());
    return points;
  }
  Result<Estimate> estimate(const std::string& id, const EstimateRequest& request) override {
    const std::lock_guard lock(mutex_);
    if (auto job = find(id); !job) return tl::unexpected(job.error());
    if (pilot.points.empty()) return fail(ErrorKind::kUnavailable, "too few sub-passes are done to tell");
    return Estimate{pilot, predict(pilot, {.passes = request.passes, .error = request.error}), 2};
  }
  Result<std::filesystem::path> artifact(const std::string& id, Artifact kind) override {
    const std::lock_guard lock(mutex_);
    if (auto job = find(id); !job) return tl::unexpected(job.error());
    const auto found = artifacts.find(kind);
    if (found == artifacts.end()) return fail(ErrorKind::kUnavailable, "the job has no image yet");
    return found->second;
  }
  Result<std::string> preview_png(const std::string& id) override {
    const std::lock_guard lock(mutex_);
    if (auto job = find(id); !job) return tl::unexpected(job.error());
    if (preview.empty()) return fail(ErrorKind::kUnavailable, "no sub-pass is done yet");
    return preview;
  }
  Result<LayerList> layers(const std::string& id) override {
    const std::lock_guard lock(mutex_);
    if (auto job = find(id); !job) return tl::unexpected(job.error());
    if (!image) return fail(ErrorKind::kUnavailable, "no sub-pass is done yet");
    return layer_list(rows_of(*image));
  }
  Result<LayerPixels> pixels(const std::string& id, const std::string& layer, int max_width) override {
    const std::lock_guard lock(mutex_);
    auto job = find(id);
    if (!job) return tl::unexpected(job.error());
    if (!image) return fail(ErrorKind::kUnavailable, "no sub-pass is done yet");
    ++pixels_made;
    auto pixels = layer_pixels(rows_of(*image), layer, max_width);
    if (pixels) pixels->passes = job->passes_done;
    return pixels;
  }
  Result<std::vector<LogEntry>> logs(const std::string& id, std::uint64_t after) override {
    const std::lock_guard lock(mutex_);
    if (auto job = find(id); !job) return tl::unexpected(job.error());
    std::vector<LogEntry> result;
    for (const LogEntry& entry : entries_) {
      if (entry.number > after && result.size() < 1000) result.push_back(entry);
    }
    return result;
  }
  std::vector<WorkerView> workers() override { return {worker}; }
  Result<WorkerView> steer(const std::string& name, WorkerVerb verb, const std::string& by) override {
    const std::lock_guard lock(mutex_);
    if (name != worker.name) return fail(ErrorKind::kUsage, "no worker '" + name + "'");
    worker.state = verb == WorkerVerb::kDrain ? "draining" : verb == WorkerVerb::kDisable ? "disabled" : "idle";
    acts.push_back(worker.state + " " + name + " by " + by);
    return worker;
  }
  std::uint64_t wait_for_change(std::uint64_t version, double seconds) override {
    std::unique_lock lock(mutex_);
    ++waits_;
    condition_.notify_all();
    condition_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return version_ != version; });
    return version_;
  }

  /// The test's side.
  void put(const JobView& job) {
    const std::lock_guard lock(mutex_);
    jobs_[job.id] = job;
    changed();
  }
  void log(const std::string& text) {
    const std::lock_guard lock(mutex_);
    entries_.push_back({entries_.size() + 1, 1'700'000'000'000, "info", "coordinator", text});
  }
  /// False when nobody watches within ten seconds (a watcher waits for a change again and again).
  bool wait_for_watcher(int times = 3) {
    std::unique_lock lock(mutex_);
    const std::uint64_t from = waits_;
    return condition_.wait_for(lock, std::chrono::seconds(10),
                               [&] { return waits_ >= from + static_cast<unsigned>(times); });
  }
  bool wait_for_submission() {
    std::unique_lock lock(mutex_);
    return condition_.wait_for(lock, std::chrono::seconds(10), [&] { return !jobs_.empty(); });
  }

  JobView new_job = running("glass-1a2b");
  std::optional<Error> submit_error;
  std::map<Artifact, std::filesystem::path> artifacts;
  std::string preview;
  std::vector<UnitView> all_units;
  std::vector<ConvergencePoint> points;
  PilotRender pilot;                  ///< of every job
  std::vector<std::string> acts;      ///< verbs that were asked for, of whom, by whom
  std::optional<LayeredImage> image;  ///< of running jobs
  int pixels_made = 0;
  WorkerView worker{"host-a-1", "host-a", 4711, "tracing", "", "glass-1a2b", 2, 1000, 7, 0.5};
  std::vector<Submission> submissions;

  static JobView running(const std::string& id) {
    JobView job;
    job.id = id;
    job.name = "glass";
    job.state = JobState::kRunning;
    job.passes_done = 16;
    job.passes_wanted = 64;
    job.rays_per_second = 3.1e6;
    job.workers = 2;
    job.seconds_left = 30;
    return job;
  }

 private:
  Result<JobView> find(const std::string& id) const {
    const auto found = jobs_.find(id);
    if (found == jobs_.end()) return fail(ErrorKind::kUsage, "no job '" + id + "'");
    return found->second;
  }
  void changed() {
    ++version_;
    condition_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable condition_;
  std::uint64_t version_ = 1, waits_ = 0;
  std::map<std::string, JobView> jobs_;
  std::vector<std::pair<std::string, std::string>> keys_;
  std::vector<LogEntry> entries_;
};

}  // namespace pf::test
