#include "jobs/doctor.h"

#include <gtest/gtest.h>

#include <fstream>

#include <nlohmann/json.hpp>

#include "jobs/process.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

class Doctor : public testing::Test {
 protected:
  [[nodiscard]] fs::path script(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << "#!/bin/sh\n" << text << '\n';
    fs::permissions(folder_ / name, fs::perms::owner_all);
    return folder_ / name;
  }

  TempFolder temp_;
  const fs::path& folder_ = temp_.path();
};

TEST_F(Doctor, AcceptsAWorkerOfTheSameBuild) {
  EXPECT_EQ(check_worker(script("worker", "echo photonfarm-worker build-1"), "build-1").health, Health::kOk);
}

TEST_F(Doctor, RefusesAWorkerOfAnotherBuildAndNamesBoth) {
  const Check check = check_worker(script("worker", "echo photonfarm-worker build-2"), "build-1");
  EXPECT_EQ(check.health, Health::kBad);
  EXPECT_EQ(check.found, "its build is build-2, this is build-1");
}

TEST_F(Doctor, RefusesAWorkerThatFails) {
  EXPECT_EQ(check_worker(script("worker", "exit 127"), "build-1").found, "--version ended with exit code 127");
  EXPECT_NE(check_worker(script("worker", "kill -ILL $$"), "build-1").found.find("signal 4"), std::string::npos);
  EXPECT_NE(check_worker(folder_ / "absent", "build-1").found.find("does not exist"), std::string::npos);
  std::ofstream(folder_ / "text") << "no program";
  EXPECT_NE(check_worker(folder_ / "text", "build-1").found.find("cannot be started"), std::string::npos);
}

TEST_F(Doctor, FindsNatsServerInThePathAndOnlyNotesItsAbsence) {
  const fs::path program = script("nats-server", "exit 0");
  const Check found = check_nats("/nowhere:" + folder_.string());
  EXPECT_EQ(found.health, Health::kOk);
  EXPECT_EQ(found.found, program.string());
  EXPECT_NE(check_nats("/nowhere").health, Health::kBad);
}

TEST_F(Doctor, AFolderThatDoesNotExistYetIsTriedWhereItWouldBeMade) {
  EXPECT_EQ(check_writable("state", folder_ / "a" / "b").health, Health::kOk);
  EXPECT_TRUE(fs::is_empty(folder_)) << "the trial file must be removed";
  EXPECT_EQ(check_writable("state", "/proc/photonfarm").health, Health::kBad);
  EXPECT_EQ(check_writable("state", "").health, Health::kBad);
}

TEST_F(Doctor, JudgesDiskAndMemoryByWhatRendersNeed) {
  constexpr std::uint64_t kMiB = 1024 * 1024;
  EXPECT_EQ(judge_disk(99 * kMiB).health, Health::kBad);
  EXPECT_EQ(judge_disk(500 * kMiB).health, Health::kNote);
  EXPECT_EQ(judge_disk(5000 * kMiB).health, Health::kOk);
  EXPECT_EQ(judge_memory(255 * kMiB).health, Health::kBad);
  EXPECT_EQ(judge_memory(500 * kMiB).health, Health::kNote);
  EXPECT_EQ(judge_memory(24 * 1024 * kMiB).found, "24 GiB available");
}

TEST_F(Doctor, IsWellUnlessACheckIsBad) {
  const std::vector<Check> notes = {{"a", Health::kOk, "fine", ""}, {"b", Health::kNote, "absent", "install it"}};
  EXPECT_TRUE(all_well(notes));
  EXPECT_EQ(doctor_text(notes, "Well.", "Unwell."),
            "ok    a              fine\n"
            "note  b              absent\n"
            "                     install it\n"
            "Well.\n");
  std::vector<Check> bad = notes;
  bad.push_back({"c", Health::kBad, "broken", "mend it"});
  EXPECT_FALSE(all_well(bad));
  EXPECT_EQ(doctor_json(bad, "id")["checks"][2]["health"], "bad");
}

TEST_F(Doctor, EveryBadOrNotedCheckOfThisMachineHasAHint) {
  for (const Check& check : examine({folder_, "", folder_ / "state", folder_, "build-1"})) {
    EXPECT_FALSE(check.found.empty()) << check.name;
    EXPECT_TRUE(check.health != Health::kBad || !check.hint.empty()) << check.name;
  }
}

TEST_F(Doctor, AProgramThatHangsIsKilled) {
  const auto run = run_and_capture(script("hangs", "echo started; exec sleep 60"), {}, 0.3);
  ASSERT_FALSE(run.has_value());
  EXPECT_EQ(run.error().kind, ErrorKind::kTimeout);
}

TEST_F(Doctor, CapturesOutputUpToALimit) {
  const auto run = run_and_capture(script("talks", "head -c 200000 /dev/zero; exit 7"), {}, 20);
  ASSERT_TRUE(run.has_value());
  EXPECT_EQ(run->output.size(), 65536U);
  EXPECT_EQ(run->end.exit_code, 7);
}

}  // namespace
}  // namespace pf
