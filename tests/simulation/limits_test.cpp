// What one token may have on the farm.

#include <gtest/gtest.h>

#include "tests/simulation/world.h"

namespace pf::test {
namespace {

TEST(JobsPerToken, OneMoreThanTheLimitIsRefusedUntilAnotherHasEnded) {
  World world(3, {});
  world.limit_jobs_per_token(2);
  world.kill_coordinator();
  world.run_for(5);
  Farm& farm = world.farm();
  const JobSpec spec = job_of("many", IntegratorType::kSppm, ProgressiveMode::kShared, 6);
  const auto submit = [&](const std::string& token, const std::string& key = "") {
    Submission submission = world.submission(spec);
    submission.submitted_by = token;
    submission.idempotency_key = key;
    return farm.submit(submission);
  };
  const auto first = submit("ada", "a-key");
  ASSERT_TRUE(first) << first.error().message;
  ASSERT_TRUE(submit("ada"));
  const auto refused = submit("ada");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, ErrorKind::kUnavailable);
  EXPECT_NE(refused.error().message.find("'ada' has 2 jobs that have not ended; expected at most 2"), std::string::npos)
      << refused.error().message;
  EXPECT_EQ(farm.list().size(), 2u);
  EXPECT_EQ(submit("ada", "a-key").value().id, first->id) << "a repetition is no further job";
  EXPECT_TRUE(submit("bob")) << "another token";

  ASSERT_TRUE(farm.act(first->id, JobEvent::kCancel, "ada"));
  ASSERT_TRUE(submit("ada")) << "one has ended";
  for (const auto& again : {farm.act(first->id, JobEvent::kRetry, "ada"),
                            farm.extend(first->id, {.passes = 9, .seconds = {}, .error = {}}, "ada")}) {
    ASSERT_FALSE(again) << "nor does an ended one come back beyond the limit";
    EXPECT_EQ(again.error().kind, ErrorKind::kUnavailable);
  }
  world.add_worker("a");
  ASSERT_TRUE(world.run(5000)) << world.describe();
  EXPECT_TRUE(farm.act(first->id, JobEvent::kRetry, "ada"));
  ASSERT_TRUE(world.run(5000)) << world.describe();
  EXPECT_EQ(farm.show(first->id)->state, JobState::kDone);
}

}  // namespace
}  // namespace pf::test
