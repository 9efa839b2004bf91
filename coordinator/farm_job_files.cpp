// What a job keeps on disk: its record, checkpoints, the radii of a round, the result.

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/base/memory.h"
#include "common/film/render_result.h"
#include "common/wire/bundle.h"
#include "common/wire/limits.h"
#include "common/wire/state_blob.h"
#include "coordinator/farm_job.h"

namespace pf {
namespace {

std::filesystem::path checkpoint_in(const std::filesystem::path& folder) { return folder / "film.checkpoint"; }

}  // namespace

Result<std::unique_ptr<FarmJob>> FarmJob::create(JobRecord record, std::span<const BlobId> blobs,
                                                 std::filesystem::path folder, const JobSurroundings& around) {
  std::unique_ptr<FarmJob> job(new FarmJob(std::move(record), std::move(folder), around));
  job->record_.submitted_unix_ms = around.unix_ms();
  if (auto inserted = around.store.insert(job->record_, blobs); !inserted) return tl::unexpected(inserted.error());
  return job;
}

std::unique_ptr<FarmJob> FarmJob::restore(JobRecord record, std::filesystem::path folder,
                                          const JobSurroundings& around) {
  std::unique_ptr<FarmJob> job(new FarmJob(std::move(record), std::move(folder), around));
  if (job->ended()) return job;
  const bool was_cancelled =
      job->record_.state == JobState::kFinishing && job->record_.end_state == JobState::kCancelled;
  if (job->record_.state != JobState::kQueued && job->record_.state != JobState::kPaused)
    job->apply(JobEvent::kRestart, "");
  const auto loaded = job->load_checkpoint();
  if (job->record_.state == JobState::kPaused) {
    if (!loaded) job->log("error", "coordinator", loaded.error().message);
    return job;
  }
  // Of another build, or damaged: said once, and nothing is overwritten.
  if (!loaded) job->end_failed(loaded.error().message);
  if (loaded && *loaded) job->take_up();
  if (was_cancelled) static_cast<void>(job->act(JobEvent::kCancel, ""));
  return job;
}

Result<bool> FarmJob::load_checkpoint() {
  if (film_) return true;
  const auto checkpoint = checkpoint_in(folder_);
  if (!std::filesystem::exists(checkpoint)) return false;
  std::string attachment;
  auto film = Film::load(checkpoint, checkpoint_identity(record_, around_.build_id), &attachment);
  auto note = film ? CheckpointNote::from_json(attachment) : tl::unexpected(film.error());
  if (!note) return tl::unexpected(note.error());
  film_ = std::make_unique<Film>(std::move(*film));
  ledger_.restore(note->done_below, note->done_beyond);
  seconds_before_ = note->seconds;
  units_done_ = note->units_done;
  units_repeated_ = note->units_repeated;
  bytes_received_ = note->bytes_received;
  merge_seconds_ = note->merge_seconds;
  checkpointed_passes_ = film_->sub_passes();
  next_result_ = note->next_result;
  results_.clear();
  if (auto points = around_.store.convergence(record_.number)) points_ = std::move(*points);
  const std::uint64_t passes = figures().passes;
  std::erase_if(points_, [&](const ConvergencePoint& point) { return point.passes > passes; });
  if (auto pruned = around_.store.forget_results(record_.number, next_result_); !pruned) {
    log("error", "coordinator", pruned.error().message);
  }
  return true;
}

void FarmJob::start_running(Film film) {
  film_ = std::make_unique<Film>(std::move(film));
  running_since_ = around_.clock.now();
  record_.started_unix_ms = around_.unix_ms();
  next_result_ = 1;
  results_.clear();
  points_.clear();
  apply(JobEvent::kRun, "");
  auto saved = around_.store.forget_results(record_.number, next_result_);
  if (saved) saved = save_checkpoint();
  if (saved) saved = write_state();
  if (!saved) wait_for_disk(saved.error());
}

Result<void> FarmJob::save_checkpoint() {
  CheckpointNote note;
  note.done_below = ledger_.done_below();
  note.done_beyond = ledger_.done_beyond();
  note.seconds = seconds();
  note.units_done = units_done_;
  note.units_repeated = units_repeated_;
  note.bytes_received = bytes_received_;
  note.merge_seconds = merge_seconds_;
  note.next_result = next_result_;
  record_.figures = figures();
  // First the database: a result that it holds and the film does not is taken off it by its number.
  if (auto stored = around_.store.checkpoint(record_, results_, points_); !stored) return stored;
  results_.clear();
  auto saved = film_->save(checkpoint_in(folder_), checkpoint_identity(record_, around_.build_id), note.to_json());
  if (!saved) return saved;
  last_checkpoint_ = around_.clock.now();
  checkpointed_passes_ = film_->sub_passes();
  return {};
}

Result<void> FarmJob::write_state() {
  if (!state_bytes_) state_bytes_ = 0;
  if (film_->state().empty()) return {};
  auto blob = write_state_blob(film_->state(), around_.blobs);
  if (!blob) return tl::unexpected(blob.error());
  // Workers of the round before may still be reading the old one; they would only be refused.
  if (state_ != *blob) drop_state();
  state_ = *blob;
  state_bytes_ = state_.bytes;
  state_round_ = film_->round_begin();
  return {};
}

/// True when units cannot be issued for want of the radii that they are to be traced with.
bool FarmJob::lacks_state() const {
  if (!film_ || film_->state().empty()) return false;
  return !state_round_ || (shares_radii() && *state_round_ != film_->round_begin());
}

void FarmJob::drop_state() {
  if (state_.bytes > 0 && !around_.others_need(record_.id, state_)) around_.blobs.remove(state_);
  state_ = {};
  state_round_.reset();
}

Result<void> FarmJob::write_result() {
  note_point(true);
  RenderResult result;
  const double start = around_.clock.now();
  result.warnings = record_.warnings;
  result.render_seconds = seconds();
  const JobSpec& spec = record_.spec;
  const auto manifest = around_.blobs.read(record_.bundle, 0, kMaxBundleBytes);
  const ResultLabels labels{
      .name = spec.job.name,
      .exposure = static_cast<float>(spec.image.exposure),
      .spec_hash = spec_hash_,
      .scene_hash = record_.scene_hash,
      .plan = record_.plan,
      .spec_json = canonical_json(spec),
      .files = file_list_json(manifest ? files_of_bundle(*manifest).value_or(FileList()) : FileList()),
      .seed = spec.integrator.seed};
  if (auto done = write_images(*film_, labels, folder_, result); !done) return done;
  result.write_seconds = around_.clock.now() - start;
  result.peak_bytes = peak_resident_bytes();
  if (auto done = write_file_atomically(result.json, result_json(spec.job.name, result)); !done) return done;
  record_.image_hash = result.image_hash;
  record_.estimated_error = result.error;
  // A job that is extended is warned of the same again.
  record_.warnings.clear();
  for (const std::string& warning : result.warnings) {
    if (std::find(record_.warnings.begin(), record_.warnings.end(), warning) == record_.warnings.end())
      record_.warnings.push_back(warning);
  }
  return save_checkpoint();
}

std::array<std::filesystem::path, 4> FarmJob::image_files() const {
  const OutputPaths paths(folder_, record_.spec.job.name);
  return {paths.exr, paths.png, paths.json, folder_ / "preview.png"};
}

void FarmJob::remove_image() {
  std::error_code ignored;
  for (const auto& file : image_files()) std::filesystem::remove(file, ignored);
}

KeptFiles FarmJob::kept_files() const {
  KeptFiles kept{record_.id, record_.ended_unix_ms, 0, 0};
  const auto size = [](const std::filesystem::path& file) -> std::uint64_t {
    std::error_code error;
    const auto bytes = std::filesystem::file_size(file, error);
    return error ? 0 : bytes;
  };
  for (const auto& file : image_files()) kept.result_bytes += size(file);
  kept.checkpoint_bytes = size(checkpoint_in(folder_));
  return kept;
}

void FarmJob::expire(const Expiry& expiry) {
  const std::string what = expiry.results ? "results" : "checkpoint";
  if (expiry.results) {
    remove_image();
  } else {
    remove_checkpoint();
  }
  record_.expired.push_back(what);
  log("info", "coordinator", fmt::format("its {} expired: {}", what, expiry.why));
  apply(JobEvent::kExpire, "");
}

void FarmJob::forget_scene() {
  record_.bundle = {};
  save_record();
}

void FarmJob::remove_checkpoint() {
  std::error_code ignored;
  std::filesystem::remove(checkpoint_in(folder_), ignored);
}

void FarmJob::wait_for_disk(const Error& error) {
  if (ended()) return;
  if (record_.state != JobState::kWaiting) state_before_waiting_ = record_.state;
  next_try_ = around_.clock.now() + 1.0;
  log("error", "coordinator", error.message + "; the job waits until there is space");
  apply(JobEvent::kHoldUp, error.message);
}

void FarmJob::shut_down() {
  if (ended() || !film_) return;
  if (auto saved = save_checkpoint(); !saved) log("error", "coordinator", saved.error().message);
}

}  // namespace pf
