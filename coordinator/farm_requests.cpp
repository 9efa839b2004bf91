// What users ask of the farm.

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/film/render_result.h"
#include "common/wire/bundle.h"
#include "coordinator/farm.h"

namespace pf {
namespace {

tl::unexpected<Error> unknown_job(const std::string& id) {
  return fail(ErrorKind::kUsage, fmt::format("no job has the id \"{}\"; see photonfarm list", id));
}

}  // namespace

Result<std::string> Farm::new_id(const std::string& name) const {
  std::string base;
  constexpr std::size_t kMaxBase = 40;
  for (const char c : name.substr(0, kMaxBase)) {
    const char lower = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    base += std::isalnum(static_cast<unsigned char>(lower)) != 0 ? lower : '-';
  }
  auto number = store_->next_number();
  if (!number) return tl::unexpected(number.error());
  for (;; ++*number) {
    std::string id = fmt::format("{}-{}", base, *number);
    if (!jobs_.contains(id) && !std::filesystem::exists(options_.state / "jobs" / id)) return id;
  }
}

double Farm::least_share() const {
  std::optional<double> share;
  for (const auto& [id, entry] : jobs_) {
    if (entry.job && entry.job->active()) share = std::min(share.value_or(entry.share), entry.share);
  }
  return share.value_or(0.0);
}

Result<void> Farm::room_for_job(const std::string& token) const {
  const auto its = std::count_if(jobs_.begin(), jobs_.end(), [&](const auto& entry) {
    return !entry.second.job->ended() && entry.second.job->record().submitted_by == token;
  });
  if (static_cast<std::uint64_t>(its) < options_.jobs_per_token) return {};
  return fail(
      ErrorKind::kUnavailable,
      fmt::format("the token '{}' has {} jobs that have not ended; expected at most {}: wait for one, or cancel one",
                  token, its, options_.jobs_per_token));
}

Result<Validation> Farm::validate(const Submission& submission) const {
  auto spec = parse_job_json(submission.spec_json, "request");
  if (!spec) return tl::unexpected(spec.error());
  Validation validation;
  for (const auto& [path, blob] : submission.files) {
    if (!blobs_.has(blob))
      validation.warnings.push_back(
          fmt::format("{}: its content {} is not here; upload it before you submit", path, blob.sha256));
  }
  const auto given = [&](const std::string& path) {
    return std::any_of(submission.files.begin(), submission.files.end(),
                       [&](const auto& file) { return file.first == path; });
  };
  for (const std::string& path : {spec->scene.file, spec->scene.environment}) {
    if (!path.empty() && !given(path))
      validation.warnings.push_back(fmt::format("{}: it is not among the files; a submission needs it", path));
  }
  if (!submission.files.empty()) {
    if (auto manifest = make_bundle(*spec, submission.files); !manifest) return tl::unexpected(manifest.error());
  }
  validation.spec_json = canonical_json(*spec);
  return validation;
}

Result<JobView> Farm::submit(const Submission& submission) {
  if (!submission.idempotency_key.empty()) {
    const auto known = store_->job_with_key(submission.idempotency_key);
    if (!known) return tl::unexpected(known.error());
    if (*known) return show(**known);
  }
  if (auto room = room_for_job(submission.submitted_by); !room) return tl::unexpected(room.error());
  auto spec = parse_job_json(submission.spec_json, "request");
  if (!spec) return tl::unexpected(spec.error());
  // Nothing else differs: extended, the pilot is the job.
  double& seconds = spec->stop.seconds;
  if (submission.pilot_seconds > 0 && (seconds <= 0 || seconds > submission.pilot_seconds))
    seconds = submission.pilot_seconds;
  for (const auto& [path, blob] : submission.files) {
    if (!blobs_.has(blob)) {
      return fail(ErrorKind::kInvalidInput,
                  fmt::format("{}: its content {} is not here; upload it first", path, blob.sha256));
    }
  }
  auto manifest = make_bundle(*spec, submission.files);
  if (!manifest) return tl::unexpected(manifest.error());
  auto bundle = blobs_.put(*manifest);
  if (!bundle) return tl::unexpected(bundle.error());

  auto new_name = new_id(spec->job.name);
  if (!new_name) return tl::unexpected(new_name.error());
  JobRecord record;
  record.id = std::move(*new_name);
  record.spec = std::move(*spec);
  record.bundle = *bundle;
  record.idempotency_key = submission.idempotency_key;
  record.submitted_by = submission.submitted_by;
  const std::string id = record.id;
  const auto folder = options_.state / "jobs" / id;
  std::error_code code;
  std::filesystem::create_directories(folder, code);
  if (code) return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", folder.string(), code.message()));
  std::vector<BlobId> blobs{*bundle};
  for (const auto& [path, blob] : submission.files) blobs.push_back(blob);
  auto job = FarmJob::create(std::move(record), blobs, folder, surroundings());
  if (!job) {
    std::filesystem::remove_all(folder, code);
    return tl::unexpected(job.error());
  }
  Entry& entry = jobs_[id];
  entry.job = std::move(*job);
  entry.log = JobLog(folder);
  ++version_;
  pump();
  return entry.job->view();
}

Result<JobList> Farm::list(const JobFilter& filter) const {
  const auto order = [](const FarmJob& job) {
    return std::pair(job.record().submitted_unix_ms, std::string_view(job.id()));
  };
  const FarmJob* before = nullptr;
  if (!filter.before.empty()) {
    before = find(filter.before);
    if (before == nullptr) return unknown_job(filter.before);
  }
  std::vector<const FarmJob*> found;
  for (const auto& [id, entry] : jobs_) {
    const JobRecord& record = entry.job->record();
    if (filter.state && record.state != *filter.state) continue;
    if (!filter.name.empty() && record.spec.job.name != filter.name) continue;
    if (before != nullptr && order(*entry.job) >= order(*before)) continue;
    found.push_back(entry.job.get());
  }
  std::sort(found.begin(), found.end(), [&](const FarmJob* a, const FarmJob* b) { return order(*a) < order(*b); });
  JobList list;
  const std::size_t skipped = found.size() - std::min(found.size(), filter.limit);
  if (skipped > 0 && skipped < found.size()) list.before = found[skipped]->id();
  for (std::size_t i = skipped; i < found.size(); ++i) list.jobs.push_back(found[i]->view());
  return list;
}

std::vector<JobView> Farm::list() const {
  JobFilter all;
  all.limit = jobs_.size();
  return std::move(list(all)->jobs);
}

Result<JobView> Farm::show(const std::string& id) const {
  const FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  return job->view();
}

Result<JobView> Farm::changed(FarmJob& job, Result<void> done) {
  if (!done) return tl::unexpected(done.error());
  ++version_;
  note_ended();
  pump();
  return job.view();
}

Result<JobView> Farm::act(const std::string& id, JobEvent verb, const std::string& by) {
  FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  if (verb == JobEvent::kRetry && job->ended()) {
    if (auto room = room_for_job(job->record().submitted_by); !room) return tl::unexpected(room.error());
  }
  const double level = least_share();
  auto done = job->act(verb, by);
  if (done && verb == JobEvent::kDiscard) free_blobs(job->record().number);
  // It does not make up for the time that it did not run.
  double& share = jobs_.at(id).share;
  share = std::max(share, level);
  return changed(*job, std::move(done));
}

Result<JobView> Farm::extend(const std::string& id, const StopChange& stops, const std::string& by) {
  FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  if (job->ended()) {
    if (auto room = room_for_job(job->record().submitted_by); !room) return tl::unexpected(room.error());
  }
  auto done = job->extend(stops, by);
  return changed(*job, std::move(done));
}

Result<JobView> Farm::change(const std::string& id, const JobChange& change, const std::string& by) {
  FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  auto done = job->change(change, by);
  return changed(*job, std::move(done));
}

Result<void> Farm::remove(const std::string& id, const std::string& by) {
  FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  if (job_step(job->record().state, JobEvent::kDelete).kind != JobStep::Kind::kGone) {
    return fail(ErrorKind::kUnavailable,
                fmt::format("{}: {}", id, why_refused(job->record().state, JobEvent::kDelete)));
  }
  // What is not removed after the record is an orphan, which the doctor finds; a record without its files
  // would be worse.
  free_blobs(job->record().number);
  if (auto removed = store_->remove(job->record().number); !removed) return removed;
  std::error_code code;
  std::filesystem::remove_all(job->folder(), code);
  if (code) log_.error("folder cannot be removed", {{"folder", job->folder().string()}, {"why", code.message()}});
  jobs_.erase(id);
  log_.info("job deleted", {{"id", id}, {"by", by}});
  ++version_;
  return {};
}

void Farm::free_blobs(std::uint64_t job) {
  const auto blobs = store_->own_blobs(job);
  const auto released = blobs ? store_->release_blobs(job) : tl::unexpected(blobs.error());
  if (!released) return log_.error("blobs cannot be released", {{"why", released.error().message}});
  for (const BlobId& blob : *blobs) blobs_.remove(blob);
}

Result<WorkerView> Farm::steer(const std::string& worker, WorkerVerb verb, const std::string& by) {
  if (!registry_.steer(worker, verb, by))
    return fail(ErrorKind::kUsage, fmt::format("no worker is called \"{}\"; see photonfarm workers", worker));
  if (auto saved = store_->save_worker({worker, by, verb}); !saved) return tl::unexpected(saved.error());
  log_.info("worker steered", {{"worker", worker}, {"to", std::string(to_string(verb))}, {"by", by}});
  if (verb == WorkerVerb::kDisable) {
    for (auto& [id, entry] : jobs_) entry.job->take_from(worker, fmt::format("{} was disabled", worker));
  }
  if (!registry_.is_quarantined(worker)) welcome(worker);
  ++version_;
  pump();
  return registry_.view(worker, clock_.now());
}

Result<UnitPage> Farm::units(const std::string& id, std::optional<std::uint64_t> after) const {
  constexpr std::size_t kAtOnce = 1000;
  const FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  return job->units(after, kAtOnce);
}

Result<std::vector<ConvergencePoint>> Farm::convergence(const std::string& id) const {
  const FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  return job->convergence();
}

Result<Estimate> Farm::estimate(const std::string& id, const EstimateRequest& request) const {
  const FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  return job->estimate(request);
}

Result<std::filesystem::path> Farm::artifact(const std::string& id, Artifact kind) const {
  const FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  const OutputPaths paths(job->folder(), job->record().spec.job.name);
  const auto file = kind == Artifact::kExr    ? paths.exr
                    : kind == Artifact::kPng  ? paths.png
                    : kind == Artifact::kJson ? paths.json
                                              : job->folder() / "film.checkpoint";
  if (!std::filesystem::exists(file)) {
    const auto& expired = job->record().expired;
    const std::string_view what = kind == Artifact::kCheckpoint ? "checkpoint" : "results";
    if (std::find(expired.begin(), expired.end(), what) != expired.end()) {
      return fail(ErrorKind::kUnavailable,
                  fmt::format("{}: its {} expired, by the farm's policy of retention", id, what));
    }
    return fail(ErrorKind::kUnavailable, fmt::format("{}: there is no {} yet; the job is {}", id,
                                                     file.filename().string(), to_string(job->record().state)));
  }
  return file;
}

Result<const Film*> Farm::film_of(const std::string& id) const {
  const FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  if (job->film() == nullptr || job->film()->sub_passes() == 0) {
    return fail(ErrorKind::kUnavailable,
                fmt::format("{}: there is no image yet; the job is {}", id, to_string(job->record().state)));
  }
  return job->film();
}

Result<LayerList> Farm::layers(const std::string& id) const {
  const auto film = film_of(id);
  if (!film) return tl::unexpected(film.error());
  return layer_list((*film)->image_rows());
}

Result<LayerPixels> Farm::pixels(const std::string& id, const std::string& layer, int max_width) const {
  const auto film = film_of(id);
  if (!film) return tl::unexpected(film.error());
  auto pixels = layer_pixels((*film)->image_rows(), layer, max_width);
  if (pixels) pixels->passes = (*film)->sub_passes();
  return pixels;
}

Result<std::string> Farm::preview_png(const std::string& id) const {
  const FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  if (job->ended()) {
    auto file = artifact(id, Artifact::kPng);
    constexpr std::uint64_t kMaxPngBytes = std::uint64_t{1} << 31;
    return file ? read_file(*file, kMaxPngBytes, ErrorKind::kInternal) : tl::unexpected(file.error());
  }
  const auto film = film_of(id);
  if (!film) return tl::unexpected(film.error());
  const auto file = job->folder() / "preview.png";
  auto written = write_png(file, (*film)->image_rows(), static_cast<float>(job->record().spec.image.exposure));
  if (!written) return tl::unexpected(written.error());
  return read_file(file, std::uint64_t{1} << 31, ErrorKind::kInternal);
}

Result<std::vector<LogEntry>> Farm::logs(const std::string& id, std::uint64_t after) const {
  const auto it = jobs_.find(id);
  if (it == jobs_.end()) return unknown_job(id);
  return it->second.log.after(after);
}

}  // namespace pf
