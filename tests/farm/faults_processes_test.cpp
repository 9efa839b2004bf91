// Processes that die, stand still, come and go: afterwards the image is the single node's.

#include <csignal>
#include <random>

#include "tests/farm/farm_fixture.h"

namespace pf::farm_test {
namespace {

using std::uniform_int_distribution;
using std::uniform_real_distribution;

/// Kills the child and waits until it is gone.
void kill_hard(Child& child) {
  child.signal(SIGKILL);
  ASSERT_TRUE(child.wait(in(kPatience)));
}

TEST_F(FarmFaults, AnUndisturbedFarmMakesTheSingleNodesImageAndTracesNothingTwice) {
  start_farm(2);
  const TestJob job;
  const std::string id = submit(job);
  expect_the_single_nodes_image(id, job);
  EXPECT_EQ(show(id).value("units_repeated", -1), 0);
}

TEST_F(FarmFaults, WorkersKilledAtAnyMomentLoseNothing) {
  for (const std::uint64_t seed : {1U, 2U}) {
    std::mt19937_64 rng(seed);
    if (seed == 1) start_farm(2);
    TestJob job;
    job.name = "killed-" + std::to_string(seed);
    job.passes = 60;
    const std::string id = submit(job);
    int kills = 0;
    while (kills < 8) {
      // From before the scene is loaded to the middle of a round.
      if (wait_until([&] { return has_ended(id); }, uniform_real_distribution(0.02, 0.9)(rng))) break;
      const int victim = uniform_int_distribution(1, 2)(rng);
      kill_hard(workers_.at(victim));
      start_worker(victim);
      ++kills;
    }
    EXPECT_GE(kills, 4) << "the job was over too soon to be disturbed; seed " << seed;
    expect_the_single_nodes_image(id, job);
  }
}

TEST_F(FarmFaults, AWorkerThatStoodStillLongerThanAckWaitCountsOnce) {
  start_farm(2);
  const TestJob job;
  const std::string id = submit(job);
  wait_for_passes(id, 5);
  workers_.at(1).signal(SIGSTOP);
  // The other one goes on alone, beyond the round that the still one had a part of.
  wait_for_passes(id, 30);
  workers_.at(1).signal(SIGCONT);
  expect_the_single_nodes_image(id, job);
}

TEST_F(FarmFaults, WithoutABarrierToo) {
  start_farm(2);
  for (const char* type : {"sppm", "path"}) {
    TestJob job;
    job.name = std::string("free-") + type;
    job.type = type;
    job.mode = "independent";
    job.passes = job.type == "path" ? 300 : 40;
    const std::string id = submit(job);
    ASSERT_TRUE(wait_until([&] { return show(id).value("workers", 0) == 2 || has_ended(id); }));
    kill_hard(workers_.at(1));
    start_worker(1);
    ASSERT_TRUE(wait_until([&] { return show(id).value("workers", 0) == 2 || has_ended(id); }));
    kill_hard(*coordinator_);
    start_coordinator();
    expect_the_single_nodes_image(id, job);
  }
}

TEST_F(FarmFaults, TheCoordinatorGoesOnWhereItsCheckpointEnds) {
  start_farm(2);
  std::mt19937_64 rng(3);
  TestJob job;
  job.passes = 60;
  const std::string id = submit(job);
  for (int kills = 0; kills < 5; ++kills) {
    // Twice before there is a film, then between checkpoints.
    if (kills >= 2) wait_for_passes(id, 8 * kills);
    if (wait_until([&] { return has_ended(id); }, uniform_real_distribution(0.05, 0.5)(rng))) break;
    kill_hard(*coordinator_);
    start_coordinator();
  }
  expect_the_single_nodes_image(id, job);
  EXPECT_NE(job_log(id).find("goes on from a checkpoint"), std::string::npos);
}

TEST_F(FarmFaults, TheEngineComesBackWithItsQueue) {
  start_farm(2);
  std::mt19937_64 rng(4);
  TestJob job;
  job.passes = 60;
  const std::string id = submit(job);
  for (int kills = 0; kills < 3; ++kills) {
    if (wait_until([&] { return has_ended(id); }, uniform_real_distribution(0.1, 1.0)(rng))) break;
    kill_hard(*engine_);
    start_engine();
  }
  expect_the_single_nodes_image(id, job);
}

TEST_F(FarmFaults, AnEngineThatLostItsQueueIsGivenTheTasksAgain) {
  start_farm(2);
  TestJob job;
  const std::string id = submit(job);
  wait_for_passes(id, 5);
  kill_hard(*engine_);
  std::filesystem::remove_all(folder_.path() / "engine" / "jetstream");
  start_engine();
  expect_the_single_nodes_image(id, job);
}

TEST_F(FarmFaults, EverythingAtOnceDies) {
  start_farm(2);
  TestJob job;
  const std::string id = submit(job);
  wait_for_passes(id, 10);
  kill_hard(*engine_);
  kill_hard(*coordinator_);
  kill_hard(workers_.at(1));
  kill_hard(workers_.at(2));
  start_engine();
  start_coordinator();
  start_worker(1);
  start_worker(2);
  expect_the_single_nodes_image(id, job);
}

TEST_F(FarmFaults, WorkersJoinAndLeaveInTheMiddleOfARound) {
  start_farm(1);
  TestJob job;
  job.passes = 60;
  const std::string id = submit(job);
  wait_for_passes(id, 10);
  start_worker(2);
  wait_for_passes(id, 20);
  start_worker(3);
  // Politely: what is done is handed in.
  workers_.at(1).signal(SIGTERM);
  const auto end = workers_.at(1).wait(in(kPatience));
  ASSERT_TRUE(end);
  EXPECT_EQ(end->exit_code, 0) << text_of("worker-1");
  wait_for_passes(id, 30);
  kill_hard(workers_.at(2));
  expect_the_single_nodes_image(id, job);
}

TEST_F(FarmFaults, AFarmWithoutWorkersWaitsForThem) {
  start_farm(0);
  TestJob job;
  job.passes = 10;
  const std::string id = submit(job);
  start_worker(1);
  expect_the_single_nodes_image(id, job);
}

TEST_F(FarmFaults, JobsOfDifferentPrioritiesShareTheWorkersAndAreBothRight) {
  start_farm(2);
  TestJob low;
  low.name = "low";
  low.priority = 20;
  // The same scene and size: the radii that their rounds begin with are the same bytes.
  TestJob high = low;
  high.name = "high";
  high.priority = 80;
  const std::string low_id = submit(low);
  const std::string high_id = submit(high);
  expect_the_single_nodes_image(high_id, high);
  expect_the_single_nodes_image(low_id, low);
  EXPECT_EQ(show(high_id).value("units_repeated", -1), 0) << job_log(high_id);
  EXPECT_EQ(show(low_id).value("units_repeated", -1), 0) << job_log(low_id);
}

TEST_F(FarmFaults, ACancelledJobKeepsItsImageAndTheOtherGoesOn) {
  start_farm(2);
  TestJob first;
  first.name = "first";
  first.passes = 4000;
  TestJob second;
  second.name = "second";
  const std::string first_id = submit(first);
  const std::string second_id = submit(second);
  wait_for_passes(first_id, 5);
  cancel(first_id);
  EXPECT_EQ(show(first_id).value("state", ""), "cancelled");
  EXPECT_NE(show(first_id).value("image_hash", ""), "");
  expect_the_single_nodes_image(second_id, second);
}

}  // namespace
}  // namespace pf::farm_test
