// What goes by the policy of retention, and what nobody needs.

#include <chrono>
#include <set>

#include <fmt/format.h>

#include "coordinator/farm.h"

namespace pf {
namespace {

constexpr double kLookSeconds = 60;
constexpr double kSweepSeconds = 3600;
/// A blob that no job needs may be an upload whose job is still to come.
constexpr std::chrono::hours kStrayAge{24};
constexpr std::size_t kHashDigits = 64;

}  // namespace

void Farm::look_at_retention() {
  const double now = clock_.now();
  if (now < next_retention_) return;
  next_retention_ = now + kLookSeconds;
  if (!options_.retention.keeps_all()) expire_files();
  if (now < next_sweep_) return;
  next_sweep_ = now + kSweepSeconds;
  sweep_blobs();
}

void Farm::expire_files() {
  std::vector<KeptFiles> kept;
  for (const auto& [id, entry] : jobs_) {
    if (entry.job->ended()) kept.push_back(entry.job->kept_files());
  }
  for (const Expiry& expiry : what_expires(options_.retention, std::move(kept), unix_ms_())) {
    FarmJob& job = *jobs_.at(expiry.job).job;
    job.expire(expiry);
    if (job.kept_files().result_bytes == 0 && job.kept_files().checkpoint_bytes == 0) {
      free_blobs(job.record().number);
      job.forget_scene();
    }
    ++version_;
  }
}

void Farm::sweep_blobs() {
  const auto needed = store_->all_blobs();
  if (!needed) return log_.error("blobs cannot be swept", {{"why", needed.error().message}});
  std::set<std::string> radii;
  for (const auto& [id, entry] : jobs_) radii.insert(entry.job->state().sha256);
  const auto oldest = std::filesystem::file_time_type::clock::now() - kStrayAge;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(options_.state / "blobs", ignored)) {
    const std::string name = entry.path().filename().string();
    if (name.size() != kHashDigits || needed->contains(name) || radii.contains(name)) continue;
    if (!entry.is_regular_file(ignored) || entry.last_write_time(ignored) > oldest) continue;
    log_.info("blob removed", {{"sha256", name}, {"why", "no job needs it"}});
    blobs_.remove({name, entry.file_size(ignored)});
  }
}

}  // namespace pf
