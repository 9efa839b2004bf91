#include "coordinator/http/streams.h"

#include <fmt/format.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <utility>

#include "coordinator/http/json.h"

namespace pf {
namespace {

using Instant = std::chrono::steady_clock::time_point;

constexpr double kWaitSeconds = 0.25;  // how late a stop or a lost client may be noticed
constexpr double kLeastPause = 0.5;    // between two events

Instant now() { return std::chrono::steady_clock::now(); }
double seconds_since(Instant t) { return std::chrono::duration<double>(now() - t).count(); }

/// Sleeps, or less when asked to stop.
void pause(const std::stop_token& stop, double seconds) {
  std::mutex mutex;
  std::condition_variable_any never;
  std::unique_lock lock(mutex);
  never.wait_for(lock, stop, std::chrono::duration<double>(seconds), [] { return false; });
}

class JobEvents {
 public:
  JobEvents(JobService& service, JobTexts& texts, std::string id, double heartbeat, std::stop_token stop)
      : service_(service), texts_(texts), id_(std::move(id)), heartbeat_(heartbeat), stop_(std::move(stop)) {}

  bool operator()(std::string& piece) {
    if (stop_.stop_requested()) return false;
    // The version is taken before the view: a change in between is seen again, never missed.
    const std::uint64_t version = service_.wait_for_change(version_, begun_ ? kWaitSeconds : 0);
    const bool changed = !begun_ || version != version_;
    version_ = version;
    begun_ = true;
    if (changed) {
      const auto job = texts_.get(id_, version);
      if (!job) return false;
      if (last_ == nullptr || (*job)->json != last_->json) {
        piece += fmt::format("event: job\ndata: {}\n", (*job)->json);
        last_ = *job;
        last_sent_ = now();
        if (last_->ended) return false;
      }
      pause(stop_, kLeastPause);
    } else if (seconds_since(last_sent_) >= heartbeat_) {
      piece += ": still here\n\n";
      last_sent_ = now();
    }
    return true;
  }

 private:
  JobService& service_;
  JobTexts& texts_;
  std::string id_;
  double heartbeat_;
  std::stop_token stop_;
  bool begun_ = false;
  std::uint64_t version_ = 0;
  std::shared_ptr<const JobTexts::Text> last_;
  Instant last_sent_ = now();
};

class LogLines {
 public:
  LogLines(JobService& service, std::string id, std::uint64_t after, bool follow, double heartbeat,
           std::stop_token stop)
      : service_(service),
        id_(std::move(id)),
        after_(after),
        follow_(follow),
        heartbeat_(heartbeat),
        stop_(std::move(stop)) {}

  bool operator()(std::string& piece) {
    if (stop_.stop_requested()) return false;
    // Asked before the entries are read: what a job logs when it ends is there once it has ended.
    const auto job = follow_ ? service_.show(id_) : Result<JobView>();
    const auto entries = service_.logs(id_, after_);
    if (!job || !entries) return false;
    for (const LogEntry& entry : *entries) {
      piece += json_line(to_json(entry));
      after_ = entry.number;
    }
    if (!entries->empty()) {
      last_sent_ = now();
      return true;
    }
    if (!follow_ || has_ended(job->state)) return false;
    if (seconds_since(last_sent_) >= heartbeat_) {
      piece += '\n';
      last_sent_ = now();
    }
    pause(stop_, kWaitSeconds);
    return true;
  }

 private:
  JobService& service_;
  std::string id_;
  std::uint64_t after_;
  bool follow_;
  double heartbeat_;
  std::stop_token stop_;
  Instant last_sent_ = now();
};

}  // namespace

Result<std::shared_ptr<const JobTexts::Text>> JobTexts::get(const std::string& id, std::uint64_t version) {
  constexpr std::size_t kMostJobs = 64;  // watched at a time: beyond, some are made anew
  const std::lock_guard lock(mutex_);
  std::shared_ptr<const Text>& text = texts_[id];
  if (text != nullptr && text->version >= version) return text;
  auto job = service_.show(id);
  if (!job) {
    texts_.erase(id);
    return tl::unexpected(job.error());
  }
  auto made = std::make_shared<const Text>(Text{version, json_line(to_json(*job)), has_ended(job->state)});
  if (texts_.size() > kMostJobs) texts_.clear();
  return texts_[id] = std::move(made);
}

NextPiece job_events(JobService& service, JobTexts& texts, std::string id, double heartbeat_seconds,
                     std::stop_token stop) {
  return JobEvents(service, texts, std::move(id), heartbeat_seconds, std::move(stop));
}

NextPiece log_lines(JobService& service, std::string id, std::uint64_t after, bool follow, double heartbeat_seconds,
                    std::stop_token stop) {
  return LogLines(service, std::move(id), after, follow, heartbeat_seconds, std::move(stop));
}

}  // namespace pf
