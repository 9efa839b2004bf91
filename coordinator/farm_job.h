#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "common/base/clock.h"
#include "common/base/result.h"
#include "common/film/film.h"
#include "common/wire/blob_store.h"
#include "common/wire/messages.h"
#include "coordinator/job_record.h"
#include "coordinator/job_service.h"
#include "coordinator/metrics.h"
#include "coordinator/result_intake.h"
#include "coordinator/unit_ledger.h"

namespace pf {

/// What a job needs of its surroundings.
struct JobSurroundings {
  BlobStore& blobs;
  const Clock& clock;
  std::function<std::int64_t()> unix_ms;
  std::string build_id;
  double ack_wait_seconds = 30;
  /// True when another job's tasks name this state: jobs of one scene and size begin with the same radii.
  std::function<bool(const std::string& job, const BlobId& state)> others_need;
  /// A line in the job's log; source is "coordinator" or a worker's name.
  std::function<void(const std::string& job, std::string_view level, std::string_view source, std::string_view text)> log;
  Metrics& metrics;
};

/// What came of something a worker said.
struct Answer {
  std::optional<wire::ResultReply> reply;
  std::string accusation;     ///< not empty: the worker returned what no right build returns; it is not to be trusted again
};

/// One job on the farm: which units are out, their results' way into the film, the barrier between rounds, checkpoints, the
/// end. Knows no engine and no worker by more than its name; all calls come from one thread.
class FarmJob {
 public:
  /// A new job, recorded in `folder`, which exists and is the job's own.
  [[nodiscard]] static Result<std::unique_ptr<FarmJob>> create(JobRecord record, std::filesystem::path folder,
                                                               const JobSurroundings& around);
  /// Goes on from the folder: units in the last checkpoint are done, all others go out again.
  [[nodiscard]] static Result<std::unique_ptr<FarmJob>> restore(std::filesystem::path folder, const JobSurroundings& around);

  [[nodiscard]] const JobRecord& record() const { return record_; }
  [[nodiscard]] const std::string& id() const { return record_.id; }
  [[nodiscard]] bool ended() const { return has_ended(record_.state); }
  [[nodiscard]] JobView view() const;
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  [[nodiscard]] const Film* film() const { return film_.get(); }
  /// Radii that its tasks name; no bytes: none.
  [[nodiscard]] const BlobId& state() const { return state_; }

  /// The next task to publish: a unit that must go out again, or a new one; `workers` live ones share what is left of the
  /// round. Empty when there is nothing to do now.
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
  [[nodiscard]] Answer on_manifest(const std::string& worker, std::uint64_t incarnation, const wire::ResultManifest& manifest);
  [[nodiscard]] Answer on_chunk(const std::string& worker, std::uint64_t incarnation, const wire::ResultChunk& chunk);
  void on_failed(const std::string& worker, const wire::TaskFailed& failed);
  /// A worker is gone for good or not trusted: what it was sending is dropped.
  void forget_worker(const std::string& worker);

  /// Time passes: stops, checkpoints, units that have been away too long. `idle_since`: true when some worker has had
  /// nothing to do since the given moment.
  void tick(const std::function<bool(double since)>& idle_since);
  /// Keeps the image so far.
  void cancel();
  /// Saves what is there before the process ends.
  void shut_down();

 private:
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
  [[nodiscard]] Answer refuse(const std::string& worker, const wire::ResultManifest& manifest, const std::string& why);
  /// Those that the result was to bring: it will not come again.
  void repeat_units_of(const std::string& worker, const wire::ResultManifest& manifest, const std::string& why);
  [[nodiscard]] Answer take_in(const std::string& worker, ResultIntake intake);
  [[nodiscard]] Answer take_in_prepared(const std::string& worker, const ResultIntake& intake);
  [[nodiscard]] Answer take_in_sums(const std::string& worker, const ResultIntake& intake);
  void compare_with_first(const std::string& worker, const wire::ResultManifest& manifest);
  void count(const std::string& worker, const wire::ResultManifest& manifest);
  void after_progress();
  void start_running(Film film);
  void repeat_unit(UnitLedger::Out& unit, std::string_view why);
  void repeat_prepare();
  void look_after_units(double now, const std::function<bool(double since)>& idle_since);

  [[nodiscard]] Result<void> save_checkpoint();
  [[nodiscard]] Result<void> write_state();
  [[nodiscard]] bool lacks_state() const;
  void drop_state();
  void finish(JobState state, const std::string& message);
  [[nodiscard]] Result<void> write_result();
  void wait_for_disk(const Error& error);
  void go_on_after_waiting(double now);
  void set_state(JobState state, const std::string& message);
  void log(std::string_view level, std::string_view source, std::string_view text) const;
  [[nodiscard]] std::string identity() const;
  [[nodiscard]] double seconds() const;
  [[nodiscard]] JobRecord::Figures figures_of_film() const;

  JobRecord record_;
  std::filesystem::path folder_;
  JobSurroundings around_;
  std::unique_ptr<Film> film_;
  BlobId state_;                                   ///< radii of the open round; no bytes: none
  std::optional<std::uint64_t> state_round_;       ///< whose radii they are
  UnitLedger ledger_;
  std::optional<UnitLedger::Out> preparing_;
  std::deque<std::uint64_t> repeat_;               ///< first sub-passes of units to publish again
  bool repeat_preparing_ = false;
  std::map<Key, ResultIntake> intakes_;
  struct First {
    std::string worker, content;
  };
  std::map<std::string, First> first_results_;     ///< the latest, by their units: a second one must equal the first,
  std::deque<std::string> first_order_;            ///< also when it comes after its round
  std::uint64_t frozen_limit_;                     ///< a stop by time: no unit beyond is issued
  JobState state_before_waiting_ = JobState::kRunning;
  std::string end_message_;                        ///< of a finishing job
  double next_try_ = 0;
  double running_since_ = 0;
  double seconds_before_ = 0;                      ///< run before this process
  double last_checkpoint_ = 0;
  std::uint64_t checkpointed_passes_ = 0;
  std::uint64_t units_done_ = 0, units_repeated_ = 0, bytes_received_ = 0;
  double merge_seconds_ = 0;
  double sub_pass_seconds_ = 0;                    ///< of tracing, smoothed; 0: not known yet
};

}  // namespace pf
