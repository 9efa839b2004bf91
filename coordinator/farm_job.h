#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "common/base/clock.h"
#include "common/base/result.h"
#include "common/film/film.h"
#include "common/wire/blob_store.h"
#include "common/wire/messages.h"
#include "coordinator/job_service.h"
#include "coordinator/metrics.h"
#include "coordinator/result_intake.h"
#include "coordinator/retention.h"
#include "coordinator/store/job_store.h"
#include "coordinator/unit_ledger.h"

namespace pf {

/// What a job needs of its surroundings.
struct JobSurroundings {
  JobStore& store;
  BlobStore& blobs;
  const Clock& clock;
  std::function<std::int64_t()> unix_ms;
  std::string build_id;
  double ack_wait_seconds = 30;
  /// True when another job's tasks name this state: jobs of one scene and size begin with the same radii.
  std::function<bool(const std::string& job, const BlobId& state)> others_need;
  /// A line in the job's log; source is "coordinator" or a worker's name.
  std::function<void(const std::string& job, std::string_view level, std::string_view source, std::string_view text)>
      log;
  Metrics& metrics;
};

/// What came of something a worker said.
struct Answer {
  std::optional<wire::ResultReply> reply;
  std::string
      accusation;  ///< not empty: the worker returned what no right build returns; it is not to be trusted again
};

/// One job on the farm: which units are out, their results' way into the film, the barrier between rounds, checkpoints,
/// the end. Knows no engine and no worker by more than its name; all calls come from one thread.
class FarmJob {
 public:
  /// A new job that needs these blobs; `folder` exists and is its own.
  [[nodiscard]] static Result<std::unique_ptr<FarmJob>> create(JobRecord record, std::span<const BlobId> blobs,
                                                               std::filesystem::path folder,
                                                               const JobSurroundings& around);
  /// Goes on from record and folder: units in the last checkpoint are done, all others go out again.
  [[nodiscard]] static std::unique_ptr<FarmJob> restore(JobRecord record, std::filesystem::path folder,
                                                        const JobSurroundings& around);

  [[nodiscard]] const JobRecord& record() const { return record_; }
  [[nodiscard]] const std::string& id() const { return record_.id; }
  [[nodiscard]] bool ended() const { return has_ended(record_.state); }
  /// Neither ended nor paused nor yet to begin: it has a film, or is about to get one.
  [[nodiscard]] bool active() const {
    return !ended() && record_.state != JobState::kQueued && record_.state != JobState::kPaused;
  }
  /// Runs whose tasks are not wanted any more: 0 .. runs_over() - 1.
  [[nodiscard]] std::uint64_t runs_over() const {
    return record_.run + (ended() || record_.state == JobState::kPaused ? 1 : 0);
  }
  [[nodiscard]] JobView view() const;
  /// Units whose first sub-pass is beyond `after`, at most `most`.
  [[nodiscard]] Result<UnitPage> units(std::optional<std::uint64_t> after, std::size_t most) const;
  [[nodiscard]] Result<std::vector<ConvergencePoint>> convergence() const;
  [[nodiscard]] Result<Estimate> estimate(const EstimateRequest& asked) const;
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  [[nodiscard]] const Film* film() const { return film_.get(); }
  /// Radii that its tasks name; no bytes: none.
  [[nodiscard]] const BlobId& state() const { return state_; }

  /// The next task to publish: a unit that must go out again, or a new one; `workers` live ones share what is left of
  /// the round. Empty when there is nothing to do now.
  [[nodiscard]] std::optional<wire::Task> next_task(std::size_t workers);
  /// The engine did not take the task: it stays to be published.
  void not_published(const wire::Task& task);
  /// True when a unit must go out again, whatever is in the queue already.
  [[nodiscard]] bool must_repeat() const { return !repeat_.empty() || repeat_preparing_; }
  /// Units in the queue, not yet with a worker as far as is known.
  [[nodiscard]] std::size_t queued() const;
  /// Expected seconds of tracing of a task; the currency of fair shares.
  [[nodiscard]] double cost(const wire::Task& task) const;

  /// `held`: units of this job that the worker says it has.
  void on_held(const std::string& worker, const std::vector<UnitRange>& held, bool preparing);
  /// A worker that works on it holds so much memory.
  void note_memory(std::uint64_t bytes);
  [[nodiscard]] Answer on_manifest(const std::string& worker, std::uint64_t incarnation,
                                   const wire::ResultManifest& manifest);
  [[nodiscard]] Answer on_chunk(const std::string& worker, std::uint64_t incarnation, const wire::ResultChunk& chunk);
  /// Not counted: its units go out again.
  [[nodiscard]] Answer refuse(const std::string& worker, const wire::ResultManifest& manifest, const std::string& why);
  void on_failed(const std::string& worker, const wire::TaskFailed& failed);
  /// A worker is gone for good or not trusted: what it was sending is dropped.
  void forget_worker(const std::string& worker);

  /// Time passes: stops, checkpoints, units that have been away too long. `idle_since`: true when some worker has had
  /// nothing to do since the given moment.
  void tick(const std::function<bool(double since)>& idle_since);
  /// kPause, kResume, kRetry, kCancel (keeps the image so far) or kDiscard. Error: kUnavailable.
  [[nodiscard]] Result<void> act(JobEvent verb, const std::string& by);
  [[nodiscard]] Result<void> extend(const StopChange& change, const std::string& by);
  [[nodiscard]] Result<void> change(const JobChange& change, const std::string& by);
  /// Of an ended job.
  [[nodiscard]] KeptFiles kept_files() const;
  void expire(const Expiry& expiry);
  /// Its files are not in the blob store any more: it cannot go on.
  void forget_scene();
  /// Hands what the worker has to others.
  void take_from(const std::string& worker, std::string_view why);
  /// Saves what is there before the process ends.
  void shut_down();

 private:
  static constexpr std::uint64_t kNoEnd = std::numeric_limits<std::uint64_t>::max();
  using Key = std::tuple<std::string, std::uint64_t, std::uint64_t>;  ///< worker, incarnation, result

  FarmJob(JobRecord record, std::filesystem::path folder, const JobSurroundings& around);
  [[nodiscard]] wire::Task make_task(wire::Task::Kind kind, const UnitLedger::Out& unit) const;
  [[nodiscard]] std::uint64_t limit() const;
  /// Sub-passes that stop.passes asks for.
  [[nodiscard]] std::uint64_t wanted_sub_passes() const;
  [[nodiscard]] std::uint64_t unit_size(std::size_t workers) const;
  [[nodiscard]] bool shares_radii() const { return film_ && film_->options().estimator == Estimator::kShared; }
  [[nodiscard]] bool has_barrier() const;
  [[nodiscard]] bool is_wanted(const wire::ResultManifest& manifest, std::string& why_not) const;
  [[nodiscard]] bool figures_are_plausible(const wire::ResultManifest& manifest) const;
  /// Those that the result was to bring: it will not come again.
  void repeat_units_of(const std::string& worker, const wire::ResultManifest& manifest, const std::string& why);
  /// How many more workers it may have; units in the queue count as if each were with another one.
  [[nodiscard]] std::size_t room_for_workers() const;
  [[nodiscard]] std::vector<std::string_view> holders() const;
  [[nodiscard]] Answer take_in(const std::string& worker, ResultIntake intake);
  [[nodiscard]] Answer take_in_prepared(const std::string& worker, const ResultIntake& intake);
  [[nodiscard]] Answer take_in_sums(const std::string& worker, const ResultIntake& intake);
  void compare_with_first(const std::string& worker, const wire::ResultManifest& manifest);
  void count(const std::string& worker, const wire::ResultManifest& manifest);
  void remember(const std::string& worker, const wire::ResultManifest& manifest);
  void note_point(bool last_of_all = false);
  void after_progress();
  void start_running(Film film);
  void repeat_unit(UnitLedger::Out& unit, std::string_view why);
  void repeat_prepare();
  void look_after_units(double now, const std::function<bool(double since)>& idle_since);

  [[nodiscard]] Result<void> save_checkpoint();
  [[nodiscard]] Result<void> write_state();
  [[nodiscard]] bool lacks_state() const;
  void drop_state();
  /// The event by the table; one that it forbids is a bug, which is logged.
  void apply(JobEvent event, const std::string& message, const std::string& by = {});
  /// Nothing is out any more.
  void take_back();
  void pause(const std::string& by);
  void begin_again(JobEvent event, const std::string& by);
  void take_up();
  /// The film of the checkpoint; false when there is none.
  [[nodiscard]] Result<bool> load_checkpoint();
  void discard(const std::string& by);
  [[nodiscard]] std::array<std::filesystem::path, 4> image_files() const;
  void remove_image();
  void remove_checkpoint();
  void forget_intakes(const std::string& worker);
  /// kFinish or kCancel: writes the image so far, then the job is done or cancelled.
  void finish(JobEvent event, const std::string& message, const std::string& by = {});
  void go_on_finishing();
  void end_failed(const std::string& message);
  void end(JobEvent event, const std::string& message);
  void stop_by_error();
  [[nodiscard]] Result<void> write_result();
  void wait_for_disk(const Error& error);
  void go_on_after_waiting(double now);
  void save_record();
  void log(std::string_view level, std::string_view source, std::string_view text) const;
  [[nodiscard]] double seconds() const;
  void stop_clock();
  [[nodiscard]] JobRecord::Figures figures() const;

  JobRecord record_;
  std::string spec_hash_;  ///< of what decides the pixels
  std::filesystem::path folder_;
  JobSurroundings around_;
  std::unique_ptr<Film> film_;
  BlobId state_;                              ///< radii of the open round; no bytes: none
  std::optional<std::uint64_t> state_round_;  ///< whose radii they are
  std::optional<std::uint64_t> state_bytes_;  ///< of the latest radii, 0: it has none; unknown before the first round
  std::uint64_t worker_bytes_ = 0;            ///< most memory that a worker held while it worked on it; 0: not known
  UnitLedger ledger_;
  std::optional<UnitLedger::Out> preparing_;
  std::deque<std::uint64_t> repeat_;  ///< first sub-passes of units to publish again
  bool repeat_preparing_ = false;
  std::map<Key, ResultIntake> intakes_;
  struct First {
    std::string worker, content;
  };
  std::map<std::string, First> first_results_;  ///< the latest, by their units: a second one must equal the first,
  std::deque<std::string> first_order_;         ///< also when it comes after its round
  std::vector<CountedResult> results_;          ///< that count and are not in the database yet
  std::uint64_t next_result_ = 1;
  std::vector<ConvergencePoint> points_;
  std::uint64_t frozen_limit_;  ///< a stop by time: no unit beyond is issued
  JobState state_before_waiting_ = JobState::kRunning;
  double next_try_ = 0;  ///< of what the disk did not take
  double running_since_ = 0;
  double seconds_before_ = 0;  ///< run before it was taken up last
  double last_checkpoint_ = 0;
  std::uint64_t checkpointed_passes_ = 0;
  std::vector<Transition> transitions_;  ///< not in the database yet
  bool unsaved_record_ = false;          ///< the disk did not take it
  double next_save_ = 0;
  std::uint64_t units_done_ = 0, units_repeated_ = 0, bytes_received_ = 0;
  double merge_seconds_ = 0;
  double sub_pass_seconds_ = 0;  ///< of tracing, smoothed; 0: not known yet
};

}  // namespace pf
