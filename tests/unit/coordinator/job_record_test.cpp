#include "coordinator/job_record.h"

#include <fstream>

#include <gtest/gtest.h>

#include "coordinator/job_log.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

JobRecord some_record() {
  JobRecord record;
  record.id = "glass-1";
  record.spec.job.name = "glass";
  record.spec.scene.file = "glass.glb";
  record.bundle = {std::string(64, 'a'), 123};
  record.state = JobState::kCancelled;
  record.message = "cancelled \"by\" hand";
  record.warnings = {"a texture \xff is odd"};
  record.figures = {12, 3, 4000, 500, 6.5};
  record.submitted_unix_ms = 1;
  return record;
}

TEST(JobRecord, ComesBackAsItWasSaved) {
  const TempFolder folder;
  const JobRecord record = some_record();
  ASSERT_TRUE(record.save(folder.path()));
  const auto loaded = JobRecord::load(folder.path());
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->id, record.id);
  EXPECT_EQ(canonical_json(loaded->spec), canonical_json(record.spec));
  EXPECT_EQ(loaded->bundle, record.bundle);
  EXPECT_EQ(loaded->state, JobState::kCancelled);
  EXPECT_EQ(loaded->message, record.message);
  EXPECT_EQ(loaded->figures.passes, 12u);
  EXPECT_EQ(loaded->figures.seconds, 6.5);
}

TEST(JobRecord, ThatIsBrokenIsAnErrorThatNamesTheFile) {
  const TempFolder folder;
  for (const char* text : {"", "{", "[]", "{\"id\": 3}", "{\"spec\": \"{}\"}"}) {
    std::ofstream(folder / "job.json") << text;
    const auto loaded = JobRecord::load(folder.path());
    ASSERT_FALSE(loaded) << text;
    EXPECT_NE(loaded.error().message.find("job.json"), std::string::npos) << loaded.error().message;
  }
}

TEST(CheckpointNote, ComesBackAndRefusesNonsense) {
  CheckpointNote note;
  note.done_below = 7;
  note.done_beyond = {{9, 2}, {20, 1}};
  note.seconds = 1.25;
  note.units_done = 10;
  const auto back = CheckpointNote::from_json(note.to_json());
  ASSERT_TRUE(back);
  EXPECT_EQ(back->done_beyond, note.done_beyond);
  EXPECT_EQ(back->done_below, 7u);
  EXPECT_EQ(back->seconds, 1.25);
  EXPECT_FALSE(CheckpointNote::from_json(""));
  EXPECT_FALSE(CheckpointNote::from_json("{\"done_below\": -1}"));
}

TEST(JobLog, GoesOnWithItsNumbersAfterARestartAndSkipsAHalfWrittenLine) {
  const TempFolder folder;
  {
    JobLog log(folder.path());
    log.add(10, "info", "coordinator", "one");
    log.add(20, "error", "worker-1", "two \xff lines\n");
  }
  std::ofstream(folder / "log.jsonl", std::ios::app) << "{\"number\": 3, \"te";
  JobLog log(folder.path());
  log.add(30, "info", "coordinator", "three");
  const auto all = log.after(0);
  ASSERT_EQ(all.size(), 3u);
  EXPECT_EQ(all[1].source, "worker-1");
  EXPECT_EQ(all[2].number, 3u);
  ASSERT_EQ(log.after(2).size(), 1u);
  EXPECT_EQ(log.after(2)[0].text, "three");
  EXPECT_EQ(JobLog(folder.path()).after(0).size(), 3u) << "the next line is whole";
}

}  // namespace
}  // namespace pf
