#include "coordinator/result_intake.h"

#include <gtest/gtest.h>

#include "common/base/hash.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

wire::ResultManifest manifest_of(const std::vector<std::string>& chunks) {
  wire::ResultManifest manifest;
  for (const std::string& chunk : chunks) manifest.add_chunk_xxh3(xxh3_64(std::string_view(chunk)));
  return manifest;
}

class Intake : public testing::Test {
 protected:
  ResultIntake open(const std::vector<std::string>& chunks) {
    auto intake = ResultIntake::open(folder_ / "spool", manifest_of(chunks));
    EXPECT_TRUE(intake);
    return std::move(*intake);
  }
  TempFolder folder_;
};

TEST_F(Intake, IsCompleteWhenEveryChunkHasComeInAnyOrder) {
  const std::vector<std::string> chunks{"first", "second chunk", "3"};
  ResultIntake intake = open(chunks);
  for (const std::uint32_t i : {2u, 0u, 1u}) {
    EXPECT_FALSE(intake.complete());
    EXPECT_TRUE(intake.put(i, chunks[i]).value());
  }
  EXPECT_TRUE(intake.complete());
  for (std::size_t i = 0; i < chunks.size(); ++i) EXPECT_EQ(intake.read(i).value(), chunks[i]);
  EXPECT_EQ(intake.bytes(), 18u);
}

TEST_F(Intake, DropsDamagedRepeatedAndUnknownChunks) {
  ResultIntake intake = open({"first", "second"});
  EXPECT_FALSE(intake.put(0, "fIrst").value());
  EXPECT_TRUE(intake.put(0, "first").value());
  EXPECT_FALSE(intake.put(0, "first").value());
  EXPECT_FALSE(intake.put(7, "first").value());
  EXPECT_FALSE(intake.complete());
  EXPECT_EQ(intake.ask(), std::vector<std::uint32_t>{1});
}

TEST_F(Intake, AsksForAFewAtATimeAndAgainForThoseThatGotLost) {
  std::vector<std::string> chunks;
  for (int i = 0; i < 40; ++i) chunks.push_back("chunk " + std::to_string(i));
  ResultIntake intake = open(chunks);
  ASSERT_EQ(intake.ask().size(), ResultIntake::kAskAtOnce);
  for (std::uint32_t i = 1; i < ResultIntake::kAskAtOnce; ++i) ASSERT_TRUE(intake.put(i, chunks[i]).value());
  EXPECT_FALSE(intake.wants_more()) << "chunk 0 is on its way, as far as is known";
  const auto again = intake.ask();
  EXPECT_EQ(again.front(), 0u);
  EXPECT_EQ(again.size(), ResultIntake::kAskAtOnce);
}

TEST_F(Intake, OfNoChunksIsCompleteAtOnce) { EXPECT_TRUE(open({}).complete()); }

TEST_F(Intake, LeavesNoFileBehind) {
  {
    ResultIntake intake = open({"first"});
    ASSERT_TRUE(intake.put(0, "first").value());
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(Intake, NamesAFolderThatIsNotThere) {
  const auto intake = ResultIntake::open(folder_ / "absent" / "spool", manifest_of({"x"}));
  ASSERT_FALSE(intake);
  EXPECT_NE(intake.error().message.find("absent"), std::string::npos);
}

}  // namespace
}  // namespace pf
