#include "coordinator/job_state.h"

#include <algorithm>
#include <array>

#include <fmt/format.h>

namespace pf {
namespace {

constexpr std::array kStates{JobState::kQueued,  JobState::kPreparing, JobState::kRunning,
                             JobState::kWaiting, JobState::kFinishing, JobState::kPaused,
                             JobState::kDone,    JobState::kFailed,    JobState::kCancelled};
constexpr std::array<std::string_view, kStates.size()> kStateNames{
    "queued", "preparing", "running", "waiting", "finishing", "paused", "done", "failed", "cancelled"};

constexpr JobStep kNo{};
constexpr JobStep kStay{JobStep::Kind::kStays, {}};
constexpr JobStep kGone{JobStep::Kind::kGone, {}};
constexpr JobStep to(JobState state) { return {JobStep::Kind::kMoves, state}; }
constexpr JobStep kQu = to(JobState::kQueued);
constexpr JobStep kPr = to(JobState::kPreparing);
constexpr JobStep kRu = to(JobState::kRunning);
constexpr JobStep kWa = to(JobState::kWaiting);
constexpr JobStep kFi = to(JobState::kFinishing);
constexpr JobStep kPa = to(JobState::kPaused);
constexpr JobStep kDo = to(JobState::kDone);
constexpr JobStep kFa = to(JobState::kFailed);
constexpr JobStep kCa = to(JobState::kCancelled);

struct Row {
  JobEvent event;
  std::string_view name;
  JobCause cause;
  std::array<JobStep, kStates.size()> steps;  ///< by state
};

constexpr JobCause kFarm = JobCause::kFarm;
constexpr JobCause kUser = JobCause::kSubmitter;
constexpr JobCause kAdmin = JobCause::kAdministrator;

// clang-format off
constexpr std::array kTable{
  //                                                           queued prep.  running waiting finish. paused done   failed cancelled
  Row{JobEvent::kPrepare,       "prepare",         kFarm,  {{ kPr,   kNo,   kNo,    kNo,    kNo,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kTakeUp,        "take up",         kFarm,  {{ kRu,   kNo,   kNo,    kNo,    kNo,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kRun,           "run",             kFarm,  {{ kNo,   kRu,   kNo,    kNo,    kNo,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kHoldUp,        "hold up",         kFarm,  {{ kNo,   kWa,   kWa,    kStay,  kWa,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kGoOnPreparing, "go on preparing", kFarm,  {{ kNo,   kNo,   kNo,    kPr,    kNo,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kGoOnRunning,   "go on running",   kFarm,  {{ kNo,   kNo,   kNo,    kRu,    kNo,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kGoOnFinishing, "go on finishing", kFarm,  {{ kNo,   kNo,   kNo,    kFi,    kNo,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kFinish,        "finish",          kFarm,  {{ kNo,   kNo,   kFi,    kNo,    kNo,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kComplete,      "complete",        kFarm,  {{ kNo,   kNo,   kNo,    kNo,    kDo,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kEndCancelled,  "end cancelled",   kFarm,  {{ kNo,   kNo,   kNo,    kNo,    kCa,    kNo,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kFail,          "fail",            kFarm,  {{ kFa,   kFa,   kFa,    kFa,    kFa,    kFa,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kRestart,       "restart",         kFarm,  {{ kStay, kQu,   kQu,    kQu,    kQu,    kStay, kStay, kStay, kStay }}},
  Row{JobEvent::kPause,         "pause",           kUser,  {{ kPa,   kPa,   kPa,    kPa,    kNo,    kStay, kNo,   kNo,   kNo   }}},
  Row{JobEvent::kResume,        "resume",          kUser,  {{ kStay, kStay, kStay,  kStay,  kStay,  kQu,   kNo,   kNo,   kNo   }}},
  Row{JobEvent::kRetry,         "retry",           kUser,  {{ kNo,   kNo,   kNo,    kNo,    kNo,    kNo,   kNo,   kQu,   kQu   }}},
  Row{JobEvent::kExtend,        "extend",          kUser,  {{ kStay, kStay, kStay,  kStay,  kNo,    kStay, kQu,   kNo,   kQu   }}},
  Row{JobEvent::kCancel,        "cancel",          kUser,  {{ kFi,   kFi,   kFi,    kFi,    kStay,  kFi,   kStay, kStay, kStay }}},
  Row{JobEvent::kDiscard,       "discard",         kUser,  {{ kCa,   kCa,   kCa,    kCa,    kCa,    kCa,   kNo,   kNo,   kStay }}},
  Row{JobEvent::kChange,        "change",          kUser,  {{ kStay, kStay, kStay,  kStay,  kStay,  kStay, kStay, kStay, kStay }}},
  Row{JobEvent::kDelete,        "delete",          kAdmin, {{ kNo,   kNo,   kNo,    kNo,    kNo,    kNo,   kGone, kGone, kGone }}},
  Row{JobEvent::kExpire,        "expire",          kFarm,  {{ kNo,   kNo,   kNo,    kNo,    kNo,    kNo,   kStay, kStay, kStay }}},
};
// clang-format on

constexpr auto kEvents = [] {
  std::array<JobEvent, kTable.size()> events{};
  for (std::size_t i = 0; i < kTable.size(); ++i) events[i] = kTable[i].event;
  return events;
}();

constexpr bool rows_stand_at_their_events() {
  for (std::size_t i = 0; i < kTable.size(); ++i) {
    if (static_cast<std::size_t>(kTable[i].event) != i) return false;
  }
  return static_cast<std::size_t>(JobEvent::kExpire) + 1 == kTable.size();
}
static_assert(rows_stand_at_their_events());

const Row& row(JobEvent event) { return kTable[static_cast<std::size_t>(event)]; }

}  // namespace

std::string_view to_string(JobState state) { return kStateNames[static_cast<std::size_t>(state)]; }
std::span<const JobState> all_job_states() { return kStates; }
std::optional<JobState> job_state_of(std::string_view name) {
  const auto found = std::find(kStateNames.begin(), kStateNames.end(), name);
  if (found == kStateNames.end()) return std::nullopt;
  return kStates[static_cast<std::size_t>(found - kStateNames.begin())];
}

std::string_view to_string(JobEvent event) { return row(event).name; }
std::span<const JobEvent> all_job_events() { return kEvents; }
std::optional<JobEvent> job_event_of(std::string_view name) {
  const auto found = std::find_if(kTable.begin(), kTable.end(), [&](const Row& r) { return r.name == name; });
  if (found == kTable.end()) return std::nullopt;
  return found->event;
}

JobCause cause_of(JobEvent event) { return row(event).cause; }

JobStep job_step(JobState state, JobEvent event) { return row(event).steps[static_cast<std::size_t>(state)]; }

std::string why_refused(JobState state, JobEvent event) {
  std::string_view hint;
  if (event == JobEvent::kDelete) {
    hint = "cancel it first";
  } else if (state == JobState::kFinishing) {
    hint = "its image is being written; try again in a moment";
  } else if (event == JobEvent::kDiscard) {
    hint = "delete it instead";
  } else if (event == JobEvent::kExtend) {
    hint = "retry it first";
  } else if (event == JobEvent::kRetry) {
    hint = state == JobState::kDone ? "extend it to have it go on" : "only a failed or cancelled job can be retried";
  } else if (has_ended(state)) {
    hint = state == JobState::kDone ? "it has ended; extend it to have it go on"
                                    : "it has ended; retry it to have it go on";
  }
  return fmt::format("a job that is {} cannot take: {}{}{}", to_string(state), to_string(event),
                     hint.empty() ? "" : "; ", hint);
}

}  // namespace pf
