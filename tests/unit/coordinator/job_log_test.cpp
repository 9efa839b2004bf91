#include "coordinator/store/job_record.h"

#include <fstream>

#include <gtest/gtest.h>

#include "coordinator/job_log.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

TEST(CheckpointNote, ComesBackAndRefusesNonsense) {
  CheckpointNote note;
  note.done_below = 7;
  note.done_beyond = {{9, 2}, {20, 1}};
  note.seconds = 1.25;
  note.units_done = 10;
  note.next_result = 4;
  const auto back = CheckpointNote::from_json(note.to_json());
  ASSERT_TRUE(back);
  EXPECT_EQ(back->done_beyond, note.done_beyond);
  EXPECT_EQ(back->done_below, 7u);
  EXPECT_EQ(back->seconds, 1.25);
  EXPECT_EQ(back->next_result, 4u);
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
