#include "coordinator/store/job_store.h"

#include <fstream>

#include <gtest/gtest.h>

#include "common/base/atomic_file.h"
#include "coordinator/store/schema.h"
#include "tests/support/paths.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

JobRecord some_record(const std::string& id) {
  JobRecord r;
  r.id = id;
  r.spec.job.name = "glass";
  r.spec.job.priority = 70;
  r.spec.scene.file = "glass.glb";
  r.spec.stop.passes = 128;
  r.bundle = {std::string(64, 'a'), 123};
  r.idempotency_key = "key of " + id;
  r.submitted_by = "ada";
  r.paused_by = "bob";
  r.max_workers = 3;
  r.run = 2;
  r.extended = 1;
  r.expired = {"checkpoint"};
  r.state = JobState::kPaused;
  r.message = "paused \"by\" hand";
  r.end_state = JobState::kCancelled;
  r.submitted_unix_ms = 1;
  r.started_unix_ms = 2;
  r.ended_unix_ms = 3;
  r.scene_hash = "scene";
  r.plan = "sppm; \xff";
  r.image_hash = "image";
  r.warnings = {"a texture is odd", "so is another"};
  r.estimated_error = 0.25;
  r.figures = {12, 3, 4000, 500, 6.5, 7, 8, 9, 0.75};
  return r;
}

void expect_equal(const JobRecord& a, const JobRecord& b) {
  EXPECT_EQ(a.number, b.number);
  EXPECT_EQ(canonical_json(a.spec), canonical_json(b.spec));
  EXPECT_EQ(a.bundle, b.bundle);
  EXPECT_EQ(std::tie(a.id, a.idempotency_key, a.submitted_by, a.paused_by, a.max_workers, a.run, a.extended, a.expired,
                     a.state, a.message, a.end_state, a.submitted_unix_ms, a.started_unix_ms, a.ended_unix_ms,
                     a.scene_hash, a.plan, a.image_hash, a.warnings, a.estimated_error),
            std::tie(b.id, b.idempotency_key, b.submitted_by, b.paused_by, b.max_workers, b.run, b.extended, b.expired,
                     b.state, b.message, b.end_state, b.submitted_unix_ms, b.started_unix_ms, b.ended_unix_ms,
                     b.scene_hash, b.plan, b.image_hash, b.warnings, b.estimated_error));
  const auto& f = a.figures;
  const auto& g = b.figures;
  EXPECT_EQ(std::tie(f.passes, f.rounds, f.rays, f.photon_paths, f.seconds, f.units_done, f.units_repeated,
                     f.bytes_received, f.merge_seconds),
            std::tie(g.passes, g.rounds, g.rays, g.photon_paths, g.seconds, g.units_done, g.units_repeated,
                     g.bytes_received, g.merge_seconds));
}

class JobStoreTest : public testing::Test {
 protected:
  [[nodiscard]] JobStore open() { return std::move(*JobStore::open(file_)); }
  [[nodiscard]] JobRecord add(JobStore& store, const std::string& id, const std::vector<BlobId>& blobs = {}) {
    JobRecord record = some_record(id);
    const auto inserted = store.insert(record, blobs);
    EXPECT_TRUE(inserted) << inserted.error().message;
    return record;
  }
  TempFolder folder_;
  std::filesystem::path file_ = folder_ / "farm.sqlite";
};

TEST_F(JobStoreTest, RecordsComeBackAsTheyWereSaved) {
  JobRecord record;
  {
    JobStore store = open();
    record = add(store, "glass-1");
    record.state = JobState::kDone;
    record.figures.passes = 64;
    ASSERT_TRUE(store.save(
        record, std::vector<Transition>{{5, JobEvent::kPause, JobState::kRunning, JobState::kPaused, "ada"},
                                        {6, JobEvent::kCancel, JobState::kPaused, JobState::kFinishing, ""}}));
  }
  JobStore store = open();
  const auto loaded = store.load();
  ASSERT_TRUE(loaded) << loaded.error().message;
  ASSERT_EQ(loaded->records.size(), 1u);
  expect_equal(loaded->records[0], record);
  const auto transitions = store.transitions(record.number).value();
  ASSERT_EQ(transitions.size(), 2u);
  EXPECT_EQ(transitions[0].event, JobEvent::kPause);
  EXPECT_EQ(transitions[0].by, "ada");
  EXPECT_EQ(transitions[1].to, JobState::kFinishing);
}

TEST_F(JobStoreTest, NumbersAreNotUsedTwice) {
  JobStore store = open();
  EXPECT_EQ(store.next_number().value(), 1u);
  const JobRecord record = add(store, "glass-1");
  EXPECT_EQ(record.number, 1u);
  ASSERT_TRUE(store.remove(record.number));
  EXPECT_EQ(store.next_number().value(), 2u);
  EXPECT_EQ(add(store, "glass-2").number, 2u);
}

TEST_F(JobStoreTest, AKeyOrAnIdIsOneJobs) {
  JobStore store = open();
  const JobRecord record = add(store, "glass-1");
  EXPECT_EQ(store.job_with_key(record.idempotency_key).value(), "glass-1");
  EXPECT_FALSE(store.job_with_key("other").value());
  JobRecord same_key = some_record("glass-2");
  same_key.idempotency_key = record.idempotency_key;
  EXPECT_FALSE(store.insert(same_key, {}));
  JobRecord same_id = some_record("glass-1");
  same_id.idempotency_key = "";
  EXPECT_FALSE(store.insert(same_id, {}));
  for (const char* id : {"a", "b"}) {
    JobRecord without_key = some_record(id);
    without_key.idempotency_key = "";
    EXPECT_TRUE(store.insert(without_key, {})) << "many have none";
  }
  EXPECT_FALSE(store.job_with_key("").value());
}

TEST_F(JobStoreTest, CountedUnitsAreAscendingAndThoseThatTheFilmDoesNotHoldAreForgotten) {
  JobStore store = open();
  const JobRecord record = add(store, "glass-1");
  const std::vector<CountedResult> results{{1, "worker-1", 2.0, "hash-1", {{{0, 4}, 1}, {{8, 12}, 2}}},
                                           {2, "worker-2", 1.0, "hash-2", {{{4, 4}, 1}}}};
  const std::vector<ConvergencePoint> points{{0.5, 4, 1, 100, std::nullopt}, {1.0, 20, 2, 500, 0.125}};
  ASSERT_TRUE(store.checkpoint(record, results, points));
  EXPECT_EQ(store.convergence(record.number).value(), points);
  auto units = store.units(record.number, 0, 10).value();
  ASSERT_EQ(units.size(), 3u);
  EXPECT_EQ(units[0].first, 0u);
  EXPECT_EQ(units[0].seconds, 0.5) << "its part of the result's";
  EXPECT_EQ(units[1].worker, "worker-2");
  EXPECT_EQ(units[2].attempts, 2u);
  EXPECT_EQ(units[2].sums_hash, "hash-1");
  EXPECT_EQ(store.units(record.number, 1, 1).value().at(0).first, 4u);
  ASSERT_TRUE(store.forget_results(record.number, 2));
  units = store.units(record.number, 0, 10).value();
  ASSERT_EQ(units.size(), 2u);
  EXPECT_EQ(units[1].first, 8u);
}

TEST_F(JobStoreTest, OnlyBlobsThatNoOtherJobNeedsAreItsOwn) {
  JobStore store = open();
  const BlobId mine{std::string(64, '1'), 1}, shared{std::string(64, '2'), 2};
  const JobRecord first = add(store, "glass-1", {mine, shared, shared});
  const JobRecord second = add(store, "glass-2", {shared});
  EXPECT_EQ(store.own_blobs(first.number).value(), std::vector<BlobId>{mine});
  EXPECT_EQ(store.all_blobs().value().size(), 2u);
  ASSERT_TRUE(store.remove(second.number));
  EXPECT_EQ(store.own_blobs(first.number).value().size(), 2u);
  ASSERT_TRUE(store.release_blobs(first.number));
  EXPECT_TRUE(store.all_blobs().value().empty());
}

TEST_F(JobStoreTest, RemovingAJobLeavesNothingOfItInAnyTable) {
  JobStore store = open();
  const JobRecord record = add(store, "glass-1", {{std::string(64, '1'), 1}});
  ASSERT_TRUE(store.save(record, std::vector<Transition>{{}}));
  ASSERT_TRUE(
      store.checkpoint(record, std::vector<CountedResult>{{1, "w", 1.0, "h", {{{0, 1}, 1}}}}, {{0.5, 4, 1, 100, 0.5}}));
  ASSERT_TRUE(store.remove(record.number));
  for (const char* table : {"jobs", "transitions", "blobs", "results", "units", "convergence"}) {
    EXPECT_EQ(store.database().number(std::string("SELECT count(*) FROM ") + table).value(), 0) << table;
  }
}

TEST_F(JobStoreTest, SteeredWorkersAreRememberedUntilTheyAreEnabled) {
  {
    JobStore store = open();
    ASSERT_TRUE(store.save_worker({"a", "ada", WorkerVerb::kDrain}));
    ASSERT_TRUE(store.save_worker({"a", "bob", WorkerVerb::kDisable}));
    ASSERT_TRUE(store.save_worker({"b", "ada", WorkerVerb::kDrain}));
    ASSERT_TRUE(store.save_worker({"b", "ada", WorkerVerb::kEnable}));
  }
  JobStore store = open();
  const auto workers = store.workers().value();
  ASSERT_EQ(workers.size(), 1u);
  EXPECT_EQ(workers[0].by, "bob");
  EXPECT_EQ(workers[0].verb, WorkerVerb::kDisable);
}

TEST_F(JobStoreTest, ARecordThatMakesNoSenseIsNamedAndTheOthersLoad) {
  JobStore store = open();
  static_cast<void>(add(store, "glass-1"));
  static_cast<void>(add(store, "glass-2"));
  ASSERT_TRUE(store.database().execute("UPDATE jobs SET state = 'asleep' WHERE id = 'glass-1'"));
  const auto loaded = store.load();
  ASSERT_TRUE(loaded);
  ASSERT_EQ(loaded->broken.size(), 1u);
  EXPECT_EQ(loaded->broken[0].first, "glass-1");
  EXPECT_NE(loaded->broken[0].second.find("asleep"), std::string::npos);
  EXPECT_EQ(loaded->records.size(), 1u);
}

TEST_F(JobStoreTest, AFileThatIsNoDatabaseIsInvalidInputAndOneOfALaterSchemaIsUsage) {
  std::ofstream(file_) << std::string(5000, 'x');
  const auto damaged = JobStore::open(file_);
  ASSERT_FALSE(damaged);
  EXPECT_EQ(damaged.error().kind, ErrorKind::kInvalidInput);
  EXPECT_NE(damaged.error().message.find("photonfarm doctor"), std::string::npos) << damaged.error().message;
  std::filesystem::remove(file_);
  {
    JobStore store = open();
    ASSERT_TRUE(store.database().execute("PRAGMA user_version = 99"));
  }
  const auto later = JobStore::open(file_);
  ASSERT_FALSE(later);
  EXPECT_EQ(later.error().kind, ErrorKind::kUsage);
  EXPECT_NE(later.error().message.find("99"), std::string::npos) << later.error().message;
}

TEST_F(JobStoreTest, AFileOfVersionOneIsBroughtUpToDateAndLosesNothing) {
  // Written by the program of the first version; tests/unit/coordinator/farm-v1.sql says how.
  const auto sql = read_file(test::source_dir() / "tests/unit/coordinator/farm-v1.sql", 1 << 20);
  ASSERT_TRUE(sql) << sql.error().message;
  {
    const auto database = Database::open(file_);
    ASSERT_TRUE(database) << database.error().message;
    const auto made = database->execute(*sql);
    ASSERT_TRUE(made) << made.error().message;
    ASSERT_EQ(database->number("PRAGMA user_version").value(), 1);
  }
  JobStore store = open();
  EXPECT_EQ(store.database().number("PRAGMA user_version").value(), schema_version());
  const auto loaded = store.load();
  ASSERT_TRUE(loaded);
  ASSERT_EQ(loaded->records.size(), 2u);
  EXPECT_EQ(loaded->records[0].id, "glass-1");
  EXPECT_EQ(loaded->records[0].figures.passes, 64u);
  EXPECT_EQ(loaded->records[1].state, JobState::kRunning);
  EXPECT_EQ(store.transitions(1).value().size(), 3u);
  EXPECT_EQ(store.units(1, 0, 10).value().size(), 2u);
  EXPECT_TRUE(store.convergence(1).value().empty());
  EXPECT_TRUE(store.save_worker({"a", "ada", WorkerVerb::kDrain}));
  EXPECT_EQ(store.next_number().value(), 4u) << "3 was deleted";
}

TEST_F(JobStoreTest, ATransactionThatIsNotCommittedLeavesNothing) {
  JobStore store = open();
  {
    auto transaction = Database::Transaction::begin(store.database());
    ASSERT_TRUE(transaction);
    ASSERT_TRUE(store.database().execute("INSERT INTO workers VALUES ('a', 'drain', '')"));
  }
  EXPECT_TRUE(store.workers().value().empty());
}

TEST(JobImport, ReadsTheRecordsOfBeforeTheDatabaseAndNamesBrokenOnes) {
  const TempFolder folder;
  std::ofstream(folder / "job.json")
      << R"({"bundle": {"bytes": 123, "sha256": ")" << std::string(64, 'a')
      << R"("}, "end_state": "done", "ended_unix_ms": 3, "estimated_error": 0.5, "figures": {"passes": 12,
    "photon_paths": 500, "rays": 4000, "rounds": 3, "seconds": 6.5}, "id": "glass-1", "idempotency_key": "k", "image_hash": "i",
    "message": "", "plan": "sppm", "scene_hash": "s", "spec": "{\"job\": {\"name\": \"glass\"}, \"scene\": {\"file\": \"glass.glb\"}}",
    "started_unix_ms": 2, "state": "running", "submitted_unix_ms": 1, "warnings": ["w"]})";
  const auto record = import_job_json(folder.path());
  ASSERT_TRUE(record) << record.error().message;
  EXPECT_EQ(record->id, "glass-1");
  EXPECT_EQ(record->state, JobState::kRunning);
  EXPECT_EQ(record->figures.passes, 12u);
  EXPECT_EQ(record->idempotency_key, "k");
  EXPECT_EQ(record->spec.job.name, "glass");
  for (const char* text : {"", "{", "[]", "{\"id\": 3}", "{\"spec\": \"{}\"}"}) {
    std::ofstream(folder / "job.json") << text;
    const auto broken = import_job_json(folder.path());
    ASSERT_FALSE(broken) << text;
    EXPECT_NE(broken.error().message.find("job.json"), std::string::npos) << broken.error().message;
  }
}

}  // namespace
}  // namespace pf
