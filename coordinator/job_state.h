#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace pf {

/// Where a job stands. Queued -> preparing (a worker loads the scene) -> running -> finishing (the image is written) ->
/// done; failed and cancelled end it too. Waiting: held up by something that the job's message names (a full disk).
/// Paused: by a user, until a user has it go on.
enum class JobState { kQueued, kPreparing, kRunning, kWaiting, kFinishing, kPaused, kDone, kFailed, kCancelled };
[[nodiscard]] std::string_view to_string(JobState state);
[[nodiscard]] std::optional<JobState> job_state_of(std::string_view name);
[[nodiscard]] std::span<const JobState> all_job_states();
[[nodiscard]] constexpr bool has_ended(JobState s) {
  return s == JobState::kDone || s == JobState::kFailed || s == JobState::kCancelled;
}

/// What happens to a job. Everything that changes a state, or is forbidden in one, is here.
enum class JobEvent {
  kPrepare,        ///< its scene is given to a worker
  kTakeUp,         ///< it goes on from its checkpoint
  kRun,            ///< its scene is prepared
  kHoldUp,         ///< the disk is full
  kGoOnPreparing,  ///< there is space again: back to where it was held up
  kGoOnRunning,
  kGoOnFinishing,
  kFinish,        ///< a stop was reached
  kComplete,      ///< the image is written
  kEndCancelled,  ///< the same, of a job that is being cancelled
  kFail,
  kRestart,  ///< another process of the coordinator took it over
  kPause,
  kResume,
  kRetry,
  kExtend,   ///< other values of its stops
  kCancel,   ///< the image so far is kept
  kDiscard,  ///< and this leaves nothing of it
  kChange,   ///< priority, most workers
  kDelete,
  kExpire  ///< results or checkpoint go, by the policy of retention
};
[[nodiscard]] std::string_view to_string(JobEvent event);
[[nodiscard]] std::optional<JobEvent> job_event_of(std::string_view name);
[[nodiscard]] std::span<const JobEvent> all_job_events();

/// Who may cause an event: the farm itself, whoever may submit jobs, or an administrator.
enum class JobCause { kFarm, kSubmitter, kAdministrator };
[[nodiscard]] JobCause cause_of(JobEvent event);

/// A cell of the table of transitions.
struct JobStep {
  enum class Kind : std::uint8_t { kRefused, kStays, kMoves, kGone };
  Kind kind = Kind::kRefused;
  JobState to = JobState::kQueued;  ///< of kMoves
  friend bool operator==(const JobStep&, const JobStep&) = default;
};
/// The table.
[[nodiscard]] JobStep job_step(JobState state, JobEvent event);
/// For a person: why the event is refused in the state, and what to do instead.
[[nodiscard]] std::string why_refused(JobState state, JobEvent event);

}  // namespace pf
