#include "coordinator/job_state.h"

#include <map>
#include <set>
#include <sstream>

#include <gtest/gtest.h>

namespace pf {
namespace {

/// What every event does in every state, as README.md and the issue have it: - refused, = stays, x gone, else the new
/// state. In the order queued preparing running waiting finishing paused done failed cancelled.
const std::map<std::string, std::string> kExpected = {
    {"prepare", "preparing - - - - - - - -"},
    {"take up", "running - - - - - - - -"},
    {"run", "- running - - - - - - -"},
    {"hold up", "- waiting waiting = waiting - - - -"},
    {"go on preparing", "- - - preparing - - - - -"},
    {"go on running", "- - - running - - - - -"},
    {"go on finishing", "- - - finishing - - - - -"},
    {"finish", "- - finishing - - - - - -"},
    {"complete", "- - - - done - - - -"},
    {"end cancelled", "- - - - cancelled - - - -"},
    {"fail", "failed failed failed failed failed failed - - -"},
    {"restart", "= queued queued queued queued = = = ="},
    {"pause", "paused paused paused paused - = - - -"},
    {"resume", "= = = = = queued - - -"},
    {"retry", "- - - - - - - queued queued"},
    {"extend", "= = = = - = queued - queued"},
    {"cancel", "finishing finishing finishing finishing = finishing = = ="},
    {"discard", "cancelled cancelled cancelled cancelled cancelled cancelled - - ="},
    {"change", "= = = = = = = = ="},
    {"delete", "- - - - - - x x x"},
    {"expire", "- - - - - - = = ="},
};

TEST(JobState, EveryEventDoesInEveryStateWhatTheTableSays) {
  ASSERT_EQ(all_job_events().size(), kExpected.size());
  for (const JobEvent event : all_job_events()) {
    std::istringstream cells(kExpected.at(std::string(to_string(event))));
    for (const JobState state : all_job_states()) {
      std::string cell;
      ASSERT_TRUE(cells >> cell) << to_string(event);
      const JobStep step = job_step(state, event);
      const std::string found = step.kind == JobStep::Kind::kRefused ? "-"
                                : step.kind == JobStep::Kind::kStays ? "="
                                : step.kind == JobStep::Kind::kGone  ? "x"
                                                                     : std::string(to_string(step.to));
      EXPECT_EQ(found, cell) << to_string(event) << " of a job that is " << to_string(state);
      EXPECT_FALSE(step.kind == JobStep::Kind::kMoves && step.to == state) << "that is no move";
    }
  }
}

TEST(JobState, OnlyUsersVerbsAreUsersAndDeletingIsAnAdministrators) {
  const std::set<JobEvent> users{JobEvent::kPause,  JobEvent::kResume,  JobEvent::kRetry, JobEvent::kExtend,
                                 JobEvent::kCancel, JobEvent::kDiscard, JobEvent::kChange};
  for (const JobEvent event : all_job_events()) {
    const JobCause expected = event == JobEvent::kDelete ? JobCause::kAdministrator
                              : users.contains(event)    ? JobCause::kSubmitter
                                                         : JobCause::kFarm;
    EXPECT_EQ(cause_of(event), expected) << to_string(event);
  }
}

TEST(JobState, NoJobIsStuck) {
  // From every state that has not ended a person gets the job to an end, with what the farm does by itself.
  for (const JobState start : all_job_states()) {
    std::set<JobState> reached{start};
    for (bool grew = true; grew;) {
      grew = false;
      for (const JobState state : std::set(reached)) {
        for (const JobEvent event : all_job_events()) {
          const JobStep step = job_step(state, event);
          if (step.kind == JobStep::Kind::kMoves && reached.insert(step.to).second) grew = true;
        }
      }
    }
    EXPECT_TRUE(reached.contains(JobState::kDone)) << to_string(start);
    if (!has_ended(start)) {
      EXPECT_NE(job_step(start, JobEvent::kCancel).kind, JobStep::Kind::kRefused) << to_string(start);
    }
  }
}

TEST(JobState, NamesComeBack) {
  for (const JobState state : all_job_states()) EXPECT_EQ(job_state_of(to_string(state)), state);
  for (const JobEvent event : all_job_events()) EXPECT_EQ(job_event_of(to_string(event)), event);
  EXPECT_FALSE(job_state_of("Done"));
  EXPECT_FALSE(job_event_of(""));
}

TEST(JobState, ARefusalSaysWhatToDoInstead) {
  for (const JobState state : all_job_states()) {
    for (const JobEvent event : all_job_events()) {
      if (job_step(state, event).kind != JobStep::Kind::kRefused || cause_of(event) == JobCause::kFarm) continue;
      EXPECT_NE(why_refused(state, event).find("; "), std::string::npos) << why_refused(state, event);
    }
  }
}

}  // namespace
}  // namespace pf
