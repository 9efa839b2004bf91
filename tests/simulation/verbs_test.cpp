// What users do to a job while the farm works on it: whatever it is, the image is the one of a single long run.

#include <fstream>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/simulation/world.h"

namespace pf::test {
namespace {

JobSpec job(const std::string& name, int passes, IntegratorType type = IntegratorType::kSppm,
            ProgressiveMode mode = ProgressiveMode::kShared) {
  return job_of(name, type, mode, passes);
}

constexpr auto kConflict = ErrorKind::kUnavailable;  // with the job's state

class Verbs : public testing::Test {
 protected:
  void start(int workers) {
    for (int i = 0; i < workers; ++i) world_.add_worker(std::string(1, static_cast<char>('a' + i)));
  }
  [[nodiscard]] JobView show(const std::string& id) { return world_.farm().show(id).value(); }
  Result<JobView> act(const std::string& id, JobEvent verb) { return world_.farm().act(id, verb, "ada"); }
  void expect_image_of(const std::string& id, const JobSpec& spec) {
    ASSERT_TRUE(world_.run(kStuck)) << world_.describe();
    EXPECT_EQ(show(id).state, JobState::kDone) << world_.describe();
    EXPECT_GE(show(id).passes_done,
              static_cast<std::uint64_t>(spec.stop.passes));  // single-pass methods take samples in fours
    EXPECT_EQ(show(id).image_hash, hash_of_single_node(spec));
  }
  /// Until the job has so many passes.
  void run_to(const std::string& id, std::uint64_t passes) {
    for (int i = 0; i < 5000 && show(id).passes_done < passes; ++i) world_.run_for(0.1);
    ASSERT_GE(show(id).passes_done, passes) << world_.describe();
  }
  World world_{77, {}};
};

TEST_F(Verbs, APausedJobStandsStillAndGoesOnToTheSameBits) {
  start(2);
  const JobSpec spec = job("shared", 31);
  const std::string id = world_.submit(spec);
  run_to(id, 3);
  ASSERT_TRUE(act(id, JobEvent::kPause));
  EXPECT_EQ(show(id).state, JobState::kPaused);
  EXPECT_EQ(show(id).paused_by, "ada");
  const JobView then = show(id);
  world_.run_for(60);
  EXPECT_EQ(show(id).passes_done, then.passes_done) << "what is on its way is taken back";
  EXPECT_EQ(show(id).seconds, then.seconds) << "its clock stands still";
  EXPECT_TRUE(world_.farm().preview_png(id)) << "the image so far can be seen";
  ASSERT_TRUE(act(id, JobEvent::kPause)) << "twice is once";
  ASSERT_TRUE(act(id, JobEvent::kResume));
  EXPECT_EQ(show(id).paused_by, "");
  const double resumed = world_.now();
  expect_image_of(id, spec);
  EXPECT_LT(world_.now() - resumed, 60) << "the engine takes the same units again at once";
}

TEST_F(Verbs, PausesAndResumesAtEveryStageMakeTheSameImage) {
  start(2);
  for (const auto type : {IntegratorType::kSppm, IntegratorType::kPath, IntegratorType::kPhotonMap}) {
    const JobSpec spec = job("often", type == IntegratorType::kPhotonMap ? 4 : 31, type);
    const std::string id = world_.submit(spec);
    for (int i = 0; i < 12 && !has_ended(show(id).state); ++i) {
      ASSERT_TRUE(act(id, JobEvent::kPause)) << to_string(show(id).state);
      world_.run_for(0.4 * i);
      if (i == 5) {
        world_.kill_coordinator();
        world_.run_for(4);
        ASSERT_EQ(show(id).state, JobState::kPaused) << "also over a restart";
      }
      ASSERT_TRUE(act(id, JobEvent::kResume));
      world_.run_for(0.3 + 0.1 * i);
    }
    expect_image_of(id, spec);
  }
}

TEST_F(Verbs, AJobThatIsPausedOnAFullDiskIsPausedAndLosesNothing) {
  start(1);
  const JobSpec spec = job("full", 31);
  const std::string id = world_.submit(spec);
  run_to(id, 3);
  world_.fill_disk(true);
  world_.run_for(10);
  ASSERT_EQ(show(id).state, JobState::kWaiting) << world_.describe();
  ASSERT_TRUE(act(id, JobEvent::kPause));
  const auto passes = show(id).passes_done;
  world_.run_for(5);
  EXPECT_EQ(show(id).state, JobState::kPaused);
  world_.fill_disk(false);
  world_.run_for(5);
  world_.kill_coordinator();
  world_.run_for(5);
  EXPECT_EQ(show(id).passes_done, passes) << "the checkpoint was written when there was space";
  ASSERT_EQ(show(id).state, JobState::kPaused);
  ASSERT_TRUE(act(id, JobEvent::kResume));
  expect_image_of(id, spec);
}

TEST_F(Verbs, ADoneJobIsExtendedToTheBitsOfOneLongRun) {
  start(2);
  for (const auto& [type, mode] : {std::pair(IntegratorType::kSppm, ProgressiveMode::kShared),
                                   std::pair(IntegratorType::kSppm, ProgressiveMode::kIndependent),
                                   std::pair(IntegratorType::kPath, ProgressiveMode::kShared),
                                   std::pair(IntegratorType::kPhotonMap, ProgressiveMode::kShared)}) {
    // 7 and 13 end within a round, which stays open.
    JobSpec spec = job("longer", 7, type, mode);
    const std::string id = world_.submit(spec);
    for (const int passes : {7, 13, 31}) {
      if (passes > 7) {
        ASSERT_TRUE(world_.farm().extend(id, {.passes = passes, .seconds = {}, .error = {}}, "ada"));
        EXPECT_FALSE(has_ended(show(id).state));
      }
      spec.stop.passes = passes;
      expect_image_of(id, spec);
    }
    EXPECT_EQ(show(id).extended, 2);
    EXPECT_EQ(show(id).passes_wanted, 31u);
  }
}

TEST_F(Verbs, ExtendingWhileTheCoordinatorDiesAndTheEngineForgetsIsTheSame) {
  start(2);
  JobSpec spec = job("longer", 7);
  const std::string id = world_.submit(spec);
  ASSERT_TRUE(world_.run(kStuck));
  world_.kill_coordinator();
  world_.run_for(4);
  ASSERT_TRUE(world_.farm().extend(id, {.passes = 40, .seconds = {}, .error = {}}, "ada"));
  world_.run_for(1);
  world_.kill_coordinator();
  world_.lose_queue();
  world_.run_for(4);
  spec.stop.passes = 40;
  expect_image_of(id, spec);
}

TEST_F(Verbs, ARunningJobIsExtendedToo) {
  start(2);
  JobSpec spec = job("longer", 20);
  const std::string id = world_.submit(spec);
  run_to(id, 5);
  ASSERT_TRUE(world_.farm().extend(id, {.passes = 31, .seconds = {}, .error = {}}, "ada"));
  spec.stop.passes = 31;
  expect_image_of(id, spec);
}

TEST_F(Verbs, AJobStoppedByTimeIsExtendedByTime) {
  start(2);
  JobSpec spec = job("timed", 0);
  spec.stop.seconds = 6;
  const std::string id = world_.submit(spec);
  ASSERT_TRUE(world_.run(kStuck));
  const auto before = show(id).passes_done;
  ASSERT_TRUE(world_.farm().extend(id, {.passes = {}, .seconds = 14.0, .error = {}}, "ada"));
  ASSERT_TRUE(world_.run(kStuck));
  EXPECT_GT(show(id).passes_done, before);
  EXPECT_GE(show(id).seconds, 14.0) << "all of its runs count";
  spec.stop.passes = static_cast<int>(show(id).passes_done);
  EXPECT_EQ(show(id).image_hash, hash_of_single_node(spec));
}

TEST_F(Verbs, NonsenseStopsAreRefusedAndChangeNothing) {
  start(1);
  const std::string id = world_.submit(job("j", 5));
  ASSERT_TRUE(world_.run(kStuck));
  const auto kind = [&](const StopChange& stops) { return world_.farm().extend(id, stops, "ada").error().kind; };
  EXPECT_EQ(kind({.passes = 5, .seconds = {}, .error = {}}), ErrorKind::kInvalidInput);
  EXPECT_EQ(kind({.passes = 3, .seconds = {}, .error = {}}), ErrorKind::kInvalidInput);
  EXPECT_EQ(kind({.passes = 0, .seconds = {}, .error = {}}), ErrorKind::kInvalidInput) << "no end at all";
  EXPECT_EQ(kind({.passes = {}, .seconds = -1.0, .error = {}}), ErrorKind::kInvalidInput);
  EXPECT_EQ(show(id).state, JobState::kDone);
  EXPECT_EQ(show(id).extended, 0);
}

TEST_F(Verbs, ACancelledJobIsRetriedFromItsCheckpoint) {
  start(2);
  const JobSpec spec = job("again", 31);
  const std::string id = world_.submit(spec);
  run_to(id, 6);
  ASSERT_TRUE(act(id, JobEvent::kCancel));
  EXPECT_EQ(show(id).state, JobState::kCancelled);
  const auto passes = show(id).passes_done;
  world_.run_for(5);
  ASSERT_TRUE(act(id, JobEvent::kRetry));
  EXPECT_EQ(show(id).passes_done, passes);
  expect_image_of(id, spec);
}

TEST_F(Verbs, AJobThatWasCancelledBeforeItBeganIsRetriedFromTheBeginning) {
  const JobSpec spec = job("again", 9);
  const std::string id = world_.submit(spec);
  ASSERT_TRUE(act(id, JobEvent::kCancel));
  EXPECT_EQ(show(id).state, JobState::kCancelled);
  ASSERT_TRUE(act(id, JobEvent::kRetry));
  start(1);
  expect_image_of(id, spec);
}

TEST_F(Verbs, WhatAStateDoesNotPermitIsAConflictThatNamesTheState) {
  start(1);
  const std::string id = world_.submit(job("j", 5));
  ASSERT_TRUE(world_.run(kStuck));
  for (const JobEvent verb : {JobEvent::kPause, JobEvent::kResume, JobEvent::kRetry, JobEvent::kDiscard}) {
    const auto refused = act(id, verb);
    ASSERT_FALSE(refused) << to_string(verb);
    EXPECT_EQ(refused.error().kind, kConflict);
    EXPECT_NE(refused.error().message.find("done"), std::string::npos) << refused.error().message;
  }
  EXPECT_TRUE(act(id, JobEvent::kCancel)) << "cancelling what has ended changes nothing";
  EXPECT_EQ(show(id).state, JobState::kDone);
  EXPECT_EQ(act("nobody", JobEvent::kPause).error().kind, ErrorKind::kUsage);
}

TEST_F(Verbs, DiscardLeavesNothingOfAJobButItsRecord) {
  start(1);
  const std::string id = world_.submit(job("gone", 31));
  run_to(id, 4);
  ASSERT_TRUE(act(id, JobEvent::kDiscard));
  EXPECT_EQ(show(id).state, JobState::kCancelled);
  for (const Artifact kind : {Artifact::kExr, Artifact::kPng, Artifact::kJson, Artifact::kCheckpoint}) {
    EXPECT_FALSE(world_.farm().artifact(id, kind));
  }
  world_.run_for(10);
  EXPECT_EQ(act(id, JobEvent::kRetry).error().kind, kConflict) << "its scene went too";
  EXPECT_EQ(world_.farm().extend(id, {.passes = 50, .seconds = {}, .error = {}}, "ada").error().kind, kConflict);
  EXPECT_TRUE(act(id, JobEvent::kDiscard)) << "twice is once";
}

TEST_F(Verbs, OnlyWhatHasEndedCanBeDeletedAndItsIdIsNotUsedAgain) {
  start(1);
  const std::string id = world_.submit(job("j", 5));
  EXPECT_EQ(world_.farm().remove(id, "ada").error().kind, kConflict);
  ASSERT_TRUE(world_.run(kStuck));
  ASSERT_TRUE(world_.farm().remove(id, "ada"));
  EXPECT_FALSE(world_.farm().show(id));
  EXPECT_FALSE(std::filesystem::exists(world_.state() / "jobs" / id));
  const JobSpec spec = job("j", 6);
  const std::string next = world_.submit(spec);
  EXPECT_NE(next, id);
  expect_image_of(next, spec);
}

TEST_F(Verbs, NoMoreWorkersThanPermittedTraceAJob) {
  start(3);
  const JobSpec spec = job("few", 60, IntegratorType::kPath);
  const std::string id = world_.submit(spec);
  ASSERT_TRUE(world_.farm().change(id, {.priority = {}, .max_workers = 1}, "ada"));
  int most = 0;
  for (int i = 0; i < 5000 && show(id).passes_done < 30; ++i) {
    world_.run_for(0.1);
    most = std::max(most, show(id).workers);
  }
  EXPECT_EQ(most, 1);
  ASSERT_TRUE(world_.farm().change(id, {.priority = 80, .max_workers = 0}, "ada"));
  EXPECT_EQ(show(id).priority, 80);
  expect_image_of(id, spec);
  EXPECT_EQ(world_.farm().change(id, {.priority = 101, .max_workers = {}}, "ada").error().kind,
            ErrorKind::kInvalidInput);
  EXPECT_EQ(world_.farm().change(id, {.priority = {}, .max_workers = 5000}, "ada").error().kind,
            ErrorKind::kInvalidInput);
}

TEST_F(Verbs, JobsOfBeforeTheDatabaseAreTakenIn) {
  const JobSpec spec = job("old", 9);
  const std::string id = world_.submit(spec);
  world_.kill_coordinator();
  {
    // As the program of then left it.
    auto store = JobStore::open(world_.state() / JobStore::kFileName);
    ASSERT_TRUE(store) << store.error().message;
    const JobRecord record = store->load().value().records.at(0);
    std::ofstream(world_.state() / "jobs" / id / "job.json") << fmt::format(
        R"({{"id": "{}", "spec": {}, "bundle": {{"sha256": "{}", "bytes": {}}}, "idempotency_key": "key", "state": "queued",
        "message": "", "end_state": "done", "submitted_unix_ms": 1, "started_unix_ms": 0, "ended_unix_ms": 0, "scene_hash": "",
        "plan": "", "image_hash": "", "warnings": [], "estimated_error": -1.0,
        "figures": {{"passes": 0, "rounds": 0, "rays": 0, "photon_paths": 0, "seconds": 0.0}}}})",
        id, nlohmann::json(canonical_json(record.spec)).dump(), record.bundle.sha256, record.bundle.bytes);
    ASSERT_TRUE(store->remove(record.number));
  }
  world_.run_for(5);
  EXPECT_FALSE(std::filesystem::exists(world_.state() / "jobs" / id / "job.json"));
  start(1);
  expect_image_of(id, spec);
  world_.kill_coordinator();
  world_.run_for(5);
  EXPECT_EQ(world_.farm().list().size(), 1u);
}

TEST_F(Verbs, FilesExpireByPolicyWithAWordInTheLogAndTheViewAndNotBefore) {
  start(1);
  constexpr double kSecond = 1.0 / 86400.0;
  world_.keep({.result_days = 900 * kSecond, .checkpoint_days = 400 * kSecond, .bytes = 0});
  world_.kill_coordinator();
  world_.run_for(5);
  const std::string id = world_.submit(job("old", 5));
  ASSERT_TRUE(world_.run(kStuck));
  world_.run_for(300);
  EXPECT_TRUE(show(id).expired.empty());
  world_.run_for(200);
  EXPECT_EQ(show(id).expired, std::vector<std::string>{"checkpoint"});
  EXPECT_FALSE(world_.farm().artifact(id, Artifact::kCheckpoint));
  EXPECT_TRUE(world_.farm().artifact(id, Artifact::kExr));
  EXPECT_EQ(world_.farm().extend(id, {.passes = 9, .seconds = {}, .error = {}}, "ada").error().kind, kConflict);
  world_.kill_coordinator();
  world_.run_for(600);
  EXPECT_EQ(show(id).expired, (std::vector<std::string>{"checkpoint", "results"}));
  EXPECT_NE(world_.farm().artifact(id, Artifact::kExr).error().message.find("expired"), std::string::npos);
  EXPECT_EQ(show(id).state, JobState::kDone) << "the record stays";
  std::string log;
  const auto entries = world_.farm().logs(id, 0);
  for (const LogEntry& entry : *entries) log += entry.text + "\n";
  EXPECT_NE(log.find("its checkpoint expired: it is kept for"), std::string::npos) << log;
  EXPECT_NE(log.find("its results expired"), std::string::npos) << log;
}

class Workers : public Verbs {
 protected:
  [[nodiscard]] WorkerView worker(const std::string& name) {
    for (const WorkerView& view : world_.farm().workers()) {
      if (view.name == name) return view;
    }
    return {};
  }
};

TEST_F(Workers, ADrainedOneHandsInWhatItHasAndTakesNoMore) {
  start(2);
  const JobSpec spec = job("drained", 60, IntegratorType::kPath);
  const std::string id = world_.submit(spec);
  run_to(id, 4);
  ASSERT_TRUE(world_.farm().steer("a", WorkerVerb::kDrain, "ada"));
  world_.run_for(10);
  EXPECT_EQ(worker("a").state, "drained");
  EXPECT_EQ(worker("a").units_held, 0);
  const auto traced = worker("a").sub_passes;
  world_.run_for(5);
  EXPECT_EQ(worker("a").sub_passes, traced);
  EXPECT_EQ(show(id).units_repeated, 0u) << "nothing was lost";
  ASSERT_TRUE(world_.farm().steer("a", WorkerVerb::kEnable, "ada"));
  expect_image_of(id, spec);
  EXPECT_GT(worker("a").sub_passes, traced);
}

TEST_F(Workers, ADisabledOnesUnitsGoToOthersAtOnceAndItStaysSoOverARestart) {
  start(2);
  const JobSpec spec = job("disabled", 60, IntegratorType::kPath);
  const std::string id = world_.submit(spec);
  run_to(id, 4);
  ASSERT_TRUE(world_.farm().steer("a", WorkerVerb::kDisable, "ada"));
  world_.run_for(10);
  EXPECT_EQ(worker("a").state, "disabled");
  EXPECT_EQ(worker("a").message, "disable, by ada");
  expect_image_of(id, spec);
  world_.kill_coordinator();
  world_.run_for(10);
  EXPECT_EQ(worker("a").state, "disabled");
  EXPECT_EQ(world_.farm().steer("nobody", WorkerVerb::kDrain, "ada").error().kind, ErrorKind::kUsage);
}

TEST_F(Verbs, ManyJobsWaitForTheirTurnAndTheOneOfHigherPriorityDoesNot) {
  start(1);
  std::vector<std::string> ids;
  for (int i = 0; i < 30; ++i) ids.push_back(world_.submit(job("many", 40)));
  world_.run_for(40);
  std::size_t begun = 0;
  for (const std::string& id : ids) begun += show(id).state == JobState::kQueued ? 0 : 1;
  EXPECT_EQ(begun, 16u) << "that many films in memory";
  JobSpec urgent = job("urgent", 5);
  urgent.job.priority = 90;
  const std::string id = world_.submit(urgent);
  for (int i = 0; i < 600 && !has_ended(show(id).state); ++i) world_.run_for(0.1);
  EXPECT_EQ(show(id).state, JobState::kDone);
  ASSERT_TRUE(world_.run(kStuck));
}

TEST_F(Verbs, UnitsSayWhoTracedWhatAndConvergenceHowFarItWas) {
  start(2);
  const JobSpec spec = job("history", 31);
  const std::string id = world_.submit(spec);
  run_to(id, 3);
  world_.kill_coordinator();
  world_.run_for(5);
  expect_image_of(id, spec);
  const auto page = world_.farm().units(id, std::nullopt);
  ASSERT_TRUE(page) << page.error().message;
  std::uint64_t next = 0;
  for (const UnitView& unit : page->units) {
    EXPECT_EQ(unit.first, next) << "every sub-pass counts once";
    next += unit.count;
    EXPECT_EQ(unit.state, "done");
    EXPECT_EQ(unit.sums_hash.size(), 32u);
    EXPECT_TRUE(unit.worker == "a" || unit.worker == "b") << unit.worker;
    EXPECT_GE(unit.attempts, 1u);
  }
  EXPECT_EQ(next, 31u);
  const auto points = world_.farm().convergence(id).value();
  ASSERT_GT(points.size(), 5u);
  for (std::size_t i = 1; i < points.size(); ++i) EXPECT_GT(points[i].passes, points[i - 1].passes);
  EXPECT_EQ(points.back().passes, 31u);
  EXPECT_TRUE(points.back().estimated_error);
}

}  // namespace
}  // namespace pf::test
