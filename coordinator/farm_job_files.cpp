// What a job keeps on disk: its record, checkpoints, the radii of a round, the result.

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

std::string FarmJob::identity() const {
  return fmt::format("farm spec {} scene {} build {}", image_hash_of_spec(record_.spec), record_.scene_hash, around_.build_id);
}

Result<std::unique_ptr<FarmJob>> FarmJob::create(JobRecord record, std::filesystem::path folder,
                                                 const JobSurroundings& around) {
  std::unique_ptr<FarmJob> job(new FarmJob(std::move(record), std::move(folder), around));
  job->record_.submitted_unix_ms = around.unix_ms();
  if (auto saved = job->record_.save(job->folder_); !saved) return tl::unexpected(saved.error());
  return job;
}

Result<std::unique_ptr<FarmJob>> FarmJob::restore(std::filesystem::path folder, const JobSurroundings& around) {
  auto record = JobRecord::load(folder);
  if (!record) return tl::unexpected(record.error());
  std::unique_ptr<FarmJob> job(new FarmJob(std::move(*record), std::move(folder), around));
  const auto checkpoint = checkpoint_in(job->folder_);
  if (!std::filesystem::exists(checkpoint)) {
    if (!job->ended()) job->record_.state = JobState::kQueued;
    return job;
  }
  std::string attachment;
  auto film = Film::load(checkpoint, job->identity(), &attachment);
  auto note = film ? CheckpointNote::from_json(attachment) : tl::unexpected(film.error());
  if (!note) {
    // Of another build, or damaged: said once, and nothing is overwritten.
    if (!job->ended()) job->set_state(JobState::kFailed, note.error().message);
    return job;
  }
  job->film_ = std::make_unique<Film>(std::move(*film));
  job->ledger_.restore(note->done_below, note->done_beyond);
  job->seconds_before_ = note->seconds;
  job->units_done_ = note->units_done;
  job->units_repeated_ = note->units_repeated;
  job->bytes_received_ = note->bytes_received;
  job->merge_seconds_ = note->merge_seconds;
  job->checkpointed_passes_ = job->film_->sub_passes();
  if (job->ended()) {
    job->film_.reset();
    return job;
  }
  job->running_since_ = job->last_checkpoint_ = around.clock.now();
  if (job->record_.state == JobState::kFinishing && job->record_.end_state == JobState::kCancelled) {
    job->finish(JobState::kCancelled, job->record_.message);
    return job;
  }
  job->set_state(JobState::kRunning, "");
  if (auto written = job->write_state(); !written) job->wait_for_disk(written.error());
  job->log("info", "coordinator", fmt::format("goes on from a checkpoint of {} sub-passes", job->film_->sub_passes()));
  return job;
}

void FarmJob::start_running(Film film) {
  film_ = std::make_unique<Film>(std::move(film));
  running_since_ = around_.clock.now();
  record_.started_unix_ms = around_.unix_ms();
  set_state(JobState::kRunning, "");
  auto saved = save_checkpoint();
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
  auto saved = film_->save(checkpoint_in(folder_), identity(), note.to_json());
  if (!saved) return saved;
  last_checkpoint_ = around_.clock.now();
  checkpointed_passes_ = film_->sub_passes();
  return {};
}

Result<void> FarmJob::write_state() {
  if (film_->state().empty()) return {};
  auto blob = write_state_blob(film_->state(), around_.blobs);
  if (!blob) return tl::unexpected(blob.error());
  // Workers of the round before may still be reading the old one; they would only be refused.
  if (state_ != *blob) drop_state();
  state_ = *blob;
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
  RenderResult result;
  const double start = around_.clock.now();
  result.warnings = record_.warnings;
  result.render_seconds = seconds();
  const JobSpec& spec = record_.spec;
  const auto manifest = around_.blobs.read(record_.bundle, 0, kMaxBundleBytes);
  const ResultLabels labels{.name = spec.job.name,
                            .exposure = static_cast<float>(spec.image.exposure),
                            .spec_hash = image_hash_of_spec(spec),
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
  record_.warnings = result.warnings;
  return save_checkpoint();
}

void FarmJob::finish(JobState state, const std::string& message) {
  record_.end_state = state;
  end_message_ = message;
  intakes_.clear();
  ledger_.restore(ledger_.done_below(), ledger_.done_beyond());
  repeat_.clear();
  preparing_.reset();
  if (film_ && film_->sub_passes() > 0 && state != JobState::kFailed) {
    set_state(JobState::kFinishing, message);
    if (auto written = write_result(); !written) return wait_for_disk(written.error());
  } else if (film_) {
    // A failed job keeps what was reached; that this may fail too is of no account any more.
    static_cast<void>(save_checkpoint());
  }
  if (film_) record_.figures = figures_of_film();
  film_.reset();
  running_since_ = 0;
  record_.ended_unix_ms = around_.unix_ms();
  set_state(state, message);
  log(state == JobState::kFailed ? "error" : "info", "coordinator",
      fmt::format("{}{}{}", to_string(state), message.empty() ? "" : ": ", message));
  drop_state();
}

void FarmJob::wait_for_disk(const Error& error) {
  if (ended()) return;
  if (record_.state != JobState::kWaiting) state_before_waiting_ = record_.state;
  next_try_ = around_.clock.now() + 1.0;
  log("error", "coordinator", error.message + "; the job waits until there is space");
  set_state(JobState::kWaiting, error.message);
}

void FarmJob::set_state(JobState state, const std::string& message) {
  record_.state = state;
  record_.message = message;
  // Waiting is not recorded: the disk that would take the record is full, and a restart finds out anew.
  if (state == JobState::kWaiting) return;
  if (auto saved = record_.save(folder_); !saved) log("error", "coordinator", saved.error().message);
}

void FarmJob::shut_down() {
  if (ended() || !film_) return;
  if (auto saved = save_checkpoint(); !saved) log("error", "coordinator", saved.error().message);
}

}  // namespace pf
