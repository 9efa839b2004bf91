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

std::string Farm::new_id(const std::string& name) const {
  std::string base;
  constexpr std::size_t kMaxBase = 40;
  for (const char c : name.substr(0, kMaxBase)) {
    const char lower = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    base += std::isalnum(static_cast<unsigned char>(lower)) != 0 ? lower : '-';
  }
  for (std::uint64_t number = jobs_.size() + 1;; ++number) {
    std::string id = fmt::format("{}-{}", base, number);
    if (!jobs_.contains(id) && !std::filesystem::exists(options_.state / "jobs" / id)) return id;
  }
}

Result<JobView> Farm::submit(const Submission& submission) {
  if (!submission.idempotency_key.empty()) {
    for (const auto& [id, entry] : jobs_) {
      if (entry.job->record().idempotency_key == submission.idempotency_key) return entry.job->view();
    }
  }
  auto spec = parse_job_json(submission.spec_json, "request");
  if (!spec) return tl::unexpected(spec.error());
  for (const auto& [path, blob] : submission.files) {
    if (!blobs_.has(blob)) {
      return fail(ErrorKind::kInvalidInput, fmt::format("{}: its content {} is not here; upload it first", path, blob.sha256));
    }
  }
  auto manifest = make_bundle(*spec, submission.files);
  if (!manifest) return tl::unexpected(manifest.error());
  auto bundle = blobs_.put(*manifest);
  if (!bundle) return tl::unexpected(bundle.error());

  JobRecord record;
  record.id = new_id(spec->job.name);
  record.spec = std::move(*spec);
  record.bundle = *bundle;
  record.idempotency_key = submission.idempotency_key;
  const std::string id = record.id;
  const auto folder = options_.state / "jobs" / id;
  std::error_code code;
  std::filesystem::create_directories(folder, code);
  if (code) return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", folder.string(), code.message()));
  auto job = FarmJob::create(std::move(record), folder, surroundings());
  if (!job) {
    std::filesystem::remove_all(folder, code);
    return tl::unexpected(job.error());
  }
  // A new job starts level with the least served one: it neither waits for nor makes up what was before it.
  double share = 0;
  bool first = true;
  for (const auto& [other, entry] : jobs_) {
    if (entry.job->ended()) continue;
    share = first ? entry.share : std::min(share, entry.share);
    first = false;
  }
  Entry& entry = jobs_[id];
  entry.job = std::move(*job);
  entry.log = JobLog(folder);
  entry.share = share;
  ++version_;
  pump();
  return entry.job->view();
}

std::vector<JobView> Farm::list() const {
  std::vector<JobView> views;
  for (const auto& [id, entry] : jobs_) views.push_back(entry.job->view());
  std::sort(views.begin(), views.end(),
            [](const JobView& a, const JobView& b) { return std::tie(a.submitted_unix_ms, a.id) < std::tie(b.submitted_unix_ms, b.id); });
  return views;
}

Result<JobView> Farm::show(const std::string& id) const {
  const FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  return job->view();
}

Result<JobView> Farm::cancel(const std::string& id) {
  FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  job->cancel();
  ++version_;
  note_ended();
  pump();
  return job->view();
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
    return fail(ErrorKind::kUnavailable,
                fmt::format("{}: there is no {} yet; the job is {}", id, file.filename().string(), to_string(job->record().state)));
  }
  return file;
}

Result<std::string> Farm::preview_png(const std::string& id) const {
  const FarmJob* job = find(id);
  if (job == nullptr) return unknown_job(id);
  if (job->ended()) {
    auto file = artifact(id, Artifact::kPng);
    constexpr std::uint64_t kMaxPngBytes = std::uint64_t{1} << 31;
    return file ? read_file(*file, kMaxPngBytes, ErrorKind::kInternal) : tl::unexpected(file.error());
  }
  if (job->film() == nullptr || job->film()->sub_passes() == 0) {
    return fail(ErrorKind::kUnavailable, fmt::format("{}: there is no image yet; the job is {}", id, to_string(job->record().state)));
  }
  const auto file = job->folder() / "preview.png";
  auto written = write_png(file, job->film()->image_rows(), static_cast<float>(job->record().spec.image.exposure));
  if (!written) return tl::unexpected(written.error());
  return read_file(file, std::uint64_t{1} << 31, ErrorKind::kInternal);
}

Result<std::vector<LogEntry>> Farm::logs(const std::string& id, std::uint64_t after) const {
  const auto it = jobs_.find(id);
  if (it == jobs_.end()) return unknown_job(id);
  return it->second.log.after(after);
}

}  // namespace pf
