#include "jobs/state_doctor.h"

#include <fstream>

#include <gtest/gtest.h>

#include "common/base/hash.h"
#include "common/film/film.h"
#include "coordinator/store/job_store.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

/// A folder that a farm has left: one job that is done, one that runs.
class StateDoctor : public testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(state_ / "blobs");
    write(state_ / "token", "0123456789abcdef\n");
    fs::permissions(state_ / "token", fs::perms::owner_read | fs::perms::owner_write);
    auto store = JobStore::open(state_ / JobStore::kFileName);
    ASSERT_TRUE(store) << store.error().message;
    add(*store, "done-1", JobState::kDone);
    add(*store, "running-2", JobState::kRunning);
    for (const char* file : {"done.exr", "done.png", "done.json"}) write(state_ / "jobs/done-1" / file, "x");
  }
  void add(JobStore& store, const std::string& id, JobState state) {
    JobRecord job;
    job.id = id;
    job.spec.job.name = id.substr(0, id.find('-'));
    job.spec.scene.file = "a.glb";
    job.state = state;
    job.figures.passes = 4;
    const std::string content = "scene of " + id;
    job.bundle = {sha256_hex(content), content.size()};
    write(blob(job.bundle.sha256), content);
    ASSERT_TRUE(store.insert(job, std::vector<BlobId>{job.bundle}));
    ASSERT_TRUE(store.save(job, std::vector<Transition>{{1, JobEvent::kComplete, JobState::kFinishing, state, ""}}));
    FilmOptions options;
    options.width = options.height = 2;
    fs::create_directories(state_ / "jobs" / id);
    ASSERT_TRUE(Film(options).save(checkpoint(id), checkpoint_identity(job, "build-1"), CheckpointNote().to_json()));
    records_[id] = job;
  }
  static void write(const fs::path& file, const std::string& text) {
    fs::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << text;
  }
  [[nodiscard]] fs::path blob(const std::string& sha256) const {
    return state_ / "blobs" / sha256.substr(0, 2) / sha256;
  }
  [[nodiscard]] fs::path checkpoint(const std::string& id) const { return state_ / "jobs" / id / "film.checkpoint"; }
  [[nodiscard]] std::vector<Check> examine(const std::string& build = "build-1") const {
    const auto checks = examine_state(state_, temp_.path(), build);
    EXPECT_TRUE(checks) << checks.error().message;
    return checks.value_or(std::vector<Check>());
  }
  /// The only finding; the disk's space apart.
  [[nodiscard]] Check finding(const std::string& build = "build-1") const {
    std::vector<Check> found;
    for (const Check& check : examine(build)) {
      if (check.health != Health::kOk && check.name != "disk") found.push_back(check);
    }
    EXPECT_EQ(found.size(), 1U) << doctor_text(found, "", "");
    return found.empty() ? Check() : found.front();
  }
  void expect_finding(Health health, const std::string& name, const std::string& words, const std::string& hint) {
    const Check check = finding();
    EXPECT_EQ(check.health, health) << check.found;
    EXPECT_EQ(check.name, name);
    EXPECT_NE(check.found.find(words), std::string::npos) << check.found;
    EXPECT_NE(check.hint.find(hint), std::string::npos) << check.hint;
  }

  TempFolder temp_;
  const fs::path state_ = temp_ / "state";
  std::map<std::string, JobRecord> records_;
};

TEST_F(StateDoctor, FindsNothingInAWholeFolderAndLeavesItAsItWas) {
  for (const Check& check : examine())
    EXPECT_TRUE(check.health == Health::kOk || check.name == "disk") << check.name << ": " << check.found;
  const auto wal = state_ / "farm.sqlite-wal";
  const bool had_log = fs::exists(wal);
  const auto hash = sha256_hex_of_file(state_ / JobStore::kFileName).value();
  static_cast<void>(examine());
  EXPECT_EQ(sha256_hex_of_file(state_ / JobStore::kFileName).value(), hash);
  EXPECT_EQ(fs::exists(wal), had_log);
}

TEST_F(StateDoctor, WorksBesideAFarmThatHoldsTheDatabase) {
  const auto store = JobStore::open(state_ / JobStore::kFileName);
  ASSERT_TRUE(store);
  EXPECT_TRUE(all_well(examine()));
}

TEST_F(StateDoctor, SaysWhenNoFarmHasWorkedThere) {
  const auto checks = examine_state(temp_ / "nothing", temp_.path(), "build-1");
  ASSERT_FALSE(checks);
  EXPECT_EQ(checks.error().kind, ErrorKind::kUsage);
}

TEST_F(StateDoctor, ADamagedDatabaseIsBadAndSaysHowToSaveWhatCanBeRead) {
  write(state_ / JobStore::kFileName, std::string(8192, 'x'));
  expect_finding(Health::kBad, "database", "not a database", ".recover");
}

TEST_F(StateDoctor, ADatabaseThatLostAPageIsBad) {
  {
    const auto store = JobStore::open(state_ / JobStore::kFileName);
    ASSERT_TRUE(store->database().execute("PRAGMA wal_checkpoint(TRUNCATE)"));
  }
  std::fstream file(state_ / JobStore::kFileName, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(4096 * 2);
  file << std::string(4096, 'x');
  file.close();
  expect_finding(Health::kBad, "database", "", ".recover");
}

TEST_F(StateDoctor, ADatabaseOfALaterProgramIsNotTouched) {
  ASSERT_TRUE(JobStore::open(state_ / JobStore::kFileName)->database().execute("PRAGMA user_version = 99"));
  expect_finding(Health::kBad, "database", "version 99", "newer");
}

TEST_F(StateDoctor, AnOlderDatabaseIsBroughtUpToDateByTheFarm) {
  ASSERT_TRUE(JobStore::open(state_ / JobStore::kFileName)
                  ->database()
                  .execute("DROP TABLE convergence; DROP TABLE workers; PRAGMA user_version = 1"));
  expect_finding(Health::kNote, "database", "version 1", "version 2");
}

TEST_F(StateDoctor, ADamagedCheckpointIsBadAndOneOfAnotherBuildIsNoted) {
  EXPECT_EQ(finding("build-2").name, "running-2");
  EXPECT_EQ(finding("build-2").health, Health::kNote);
  write(checkpoint("running-2"), "no checkpoint");
  expect_finding(Health::kBad, "running-2", "not a whole checkpoint", "retry");
}

TEST_F(StateDoctor, MissingFilesAreNamedWithWhatToDo) {
  fs::remove(state_ / "jobs/done-1/done.png");
  expect_finding(Health::kBad, "done-1", "done.png is missing", "extend");
}

TEST_F(StateDoctor, AMissingCheckpointIsBadForAJobThatRunsAndNotedForOneThatIsDone) {
  fs::remove(checkpoint("done-1"));
  expect_finding(Health::kNote, "done-1", "checkpoint is missing", "cannot be extended");
}

TEST_F(StateDoctor, ExpiredFilesAreNotMissed) {
  fs::remove_all(state_ / "jobs/done-1");
  auto store = JobStore::open(state_ / JobStore::kFileName);
  records_["done-1"].number = 1;
  records_["done-1"].expired = {"checkpoint", "results"};
  ASSERT_TRUE(store->save(records_["done-1"], {}));
  for (const Check& check : examine())
    EXPECT_TRUE(check.health == Health::kOk || check.name == "disk") << check.name << ": " << check.found;
}

TEST_F(StateDoctor, ADamagedOrMissingBlobIsNamedWithItsJob) {
  write(blob(records_["running-2"].bundle.sha256), "another");
  expect_finding(Health::kBad, "running-2", "is damaged", "submit");
  fs::remove(blob(records_["running-2"].bundle.sha256));
  expect_finding(Health::kBad, "running-2", "is missing", "submit");
}

TEST_F(StateDoctor, OrphansAreNoted) {
  fs::create_directories(state_ / "jobs/gone-7");
  expect_finding(Health::kNote, "gone-7", "no job", "rm -r");
  fs::remove(state_ / "jobs/gone-7");
  write(blob(sha256_hex(std::string_view("stray"))), "stray");
  expect_finding(Health::kNote, "blobs", "1 files of 5 bytes", "older than a day");
}

TEST_F(StateDoctor, AHistoryThatDoesNotLeadToTheStateIsBad) {
  auto store = JobStore::open(state_ / JobStore::kFileName);
  ASSERT_TRUE(store->database().execute("UPDATE jobs SET state = 'failed' WHERE id = 'done-1'"));
  store = fail(ErrorKind::kUsage, "");
  expect_finding(Health::kBad, "done-1", "last transition", "report");
}

TEST_F(StateDoctor, ATokenThatOthersMayReadIsBad) {
  fs::permissions(state_ / "token", fs::perms::owner_all | fs::perms::group_read);
  expect_finding(Health::kBad, "token", "others", "chmod 600");
}

}  // namespace
}  // namespace pf
