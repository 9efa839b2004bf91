// What a job is going to cost, foretold from its first seconds, and what came.

#include <gtest/gtest.h>

#include "tests/simulation/world.h"

namespace pf::test {
namespace {

constexpr double kStuck = 5000.0;

class Estimates : public testing::Test {
 protected:
  [[nodiscard]] JobView show(const std::string& id) { return world_.farm().show(id).value(); }
  Result<Estimate> estimate(const std::string& id, EstimateRequest request = {}) {
    return world_.farm().estimate(id, request);
  }
  [[nodiscard]] std::string submit_pilot(const JobSpec& spec, double seconds) {
    Submission submission = world_.submission(spec);
    submission.pilot_seconds = seconds;
    return world_.farm().submit(submission).value().id;
  }
  World world_{5, {}};
};

void expect_known(const Range& range) {
  EXPECT_GT(range.low, 0);
  EXPECT_LE(range.low, range.likely);
  EXPECT_LE(range.likely, range.high);
}

TEST_F(Estimates, APilotForetellsTheJobAndGoesOnToBeIt) {
  for (const char* name : {"a", "b"}) world_.add_worker(name);
  JobSpec spec = job_of("pilot", IntegratorType::kSppm, ProgressiveMode::kShared, 300);
  const std::string id = submit_pilot(spec, 20);
  ASSERT_TRUE(world_.run(kStuck)) << world_.describe();
  ASSERT_EQ(show(id).state, JobState::kDone);
  EXPECT_EQ(show(id).stop_seconds, 20);
  ASSERT_LT(show(id).passes_done, 150u);
  const auto foretold = estimate(id);
  ASSERT_TRUE(foretold) << foretold.error().message;
  EXPECT_EQ(foretold->prediction.passes, 300);
  EXPECT_EQ(foretold->workers, 2);
  expect_known(foretold->prediction.seconds);
  expect_known(foretold->prediction.memory_bytes);
  expect_known(foretold->prediction.network_bytes);
  const auto to_error = estimate(id, {.passes = 0, .error = *show(id).estimated_error / 2});
  ASSERT_TRUE(to_error);
  ASSERT_TRUE(to_error->prediction.passes_to_error);
  EXPECT_GT(to_error->prediction.passes_to_error->low, static_cast<double>(show(id).passes_done));

  ASSERT_TRUE(world_.farm().extend(id, {.passes = {}, .seconds = 0.0, .error = {}}, "ada"));
  ASSERT_TRUE(world_.run(kStuck)) << world_.describe();
  EXPECT_EQ(show(id).image_hash, hash_of_single_node(spec)) << "the pilot's work is the job's";
  EXPECT_GT(show(id).seconds, 0.8 * foretold->prediction.seconds.low);
  EXPECT_LT(show(id).seconds, 1.25 * foretold->prediction.seconds.high);
}

TEST_F(Estimates, AreRefusedWhileNothingIsKnownAndWhereNothingBoundsTheJob) {
  JobSpec spec = job_of("early", IntegratorType::kPath, ProgressiveMode::kShared, 40);
  spec.stop.passes = 0;
  spec.stop.seconds = 30;
  const std::string id = world_.submit(spec);
  world_.run_for(1);
  EXPECT_EQ(estimate(id).error().kind, ErrorKind::kUnavailable) << "no sub-pass is done";
  EXPECT_EQ(estimate("nobody").error().kind, ErrorKind::kUsage);
  world_.add_worker("a");
  ASSERT_TRUE(world_.run(kStuck)) << world_.describe();
  EXPECT_EQ(estimate(id).error().kind, ErrorKind::kInvalidInput) << "for how many passes?";
  const auto known = estimate(id, {.passes = 1000, .error = 0});
  ASSERT_TRUE(known) << known.error().message;
  expect_known(known->prediction.network_bytes);
  world_.kill_coordinator();
  world_.run_for(5);
  const auto later = estimate(id, {.passes = 1000, .error = 0});
  ASSERT_TRUE(later) << later.error().message;
  EXPECT_EQ(later->prediction.seconds.likely, known->prediction.seconds.likely) << "over a restart too";
  EXPECT_EQ(later->prediction.memory_bytes.likely, 0) << "that is not kept: not known any more";
  EXPECT_EQ(later->prediction.network_bytes.likely, 0);
}

}  // namespace
}  // namespace pf::test
