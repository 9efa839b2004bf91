// Thousands of seeded schedules of everything that farms meet; after each the image of one undisturbed machine.

#include <algorithm>
#include <cstdlib>

#include <gtest/gtest.h>

#include "tests/simulation/world.h"

namespace pf::test {
namespace {

JobSpec shared_job() { return job_of("shared", IntegratorType::kSppm, ProgressiveMode::kShared, 31); }
JobSpec independent_job() { return job_of("independent", IntegratorType::kSppm, ProgressiveMode::kIndependent, 23); }
JobSpec path_job() { return job_of("path", IntegratorType::kPath, ProgressiveMode::kShared, 17); }
/// A method whose sub-passes are tiles of the image.
JobSpec tiles_job() { return job_of("tiles", IntegratorType::kPhotonMap, ProgressiveMode::kShared, 4); }

void expect_the_single_nodes_images(World& world, const std::vector<JobSpec>& specs, std::uint64_t seed) {
  std::vector<std::string> ids;
  for (const JobSpec& spec : specs) ids.push_back(world.submit(spec));
  ASSERT_TRUE(world.run(kStuck)) << "stuck; seed " << seed << "; " << world.describe();
  for (std::size_t i = 0; i < specs.size(); ++i) {
    const auto view = world.farm().show(ids[i]);
    ASSERT_TRUE(view) << view.error().message << "; seed " << seed;
    EXPECT_EQ(view->state, JobState::kDone) << view->message << "; seed " << seed;
    EXPECT_EQ(view->passes_done, static_cast<std::uint64_t>(specs[i].stop.passes)) << "seed " << seed;
    EXPECT_EQ(view->image_hash, hash_of_single_node(specs[i])) << specs[i].job.name << "; seed " << seed;
  }
}

TEST(Schedules, UndisturbedWorkersMakeTheSingleNodesImageWithoutTracingTwice) {
  World world(1, {});
  for (const char* name : {"a", "b", "c"}) world.add_worker(name);
  expect_the_single_nodes_images(world, {shared_job(), independent_job(), path_job(), tiles_job()}, 1);
  EXPECT_EQ(world.traced(), 31u + 23u + 17u + PassOrder(pretended_film(tiles_job())).sub_passes(4));
}

class Seeds : public testing::TestWithParam<int> {
 protected:
  /// Schedules per parameter; more when a person asks.
  [[nodiscard]] static int count() {
    const char* wanted = std::getenv("PHOTONFARM_SCHEDULES");
    return wanted != nullptr ? std::atoi(wanted) : 100;
  }
};

TEST_P(Seeds, GiveTheSingleNodesImageWhateverHappens) {
  for (int i = 0; i < count(); ++i) {
    const auto seed = static_cast<std::uint64_t>(GetParam() * 100000 + i);
    std::mt19937_64 rng(seed);
    const auto up_to = [&](double most) { return most * std::uniform_real_distribution<double>(0.0, 1.0)(rng); };
    Mischief mischief;
    mischief.drop = up_to(0.2);
    mischief.repeat = up_to(0.2);
    mischief.delay = up_to(0.1);
    mischief.corrupt_chunk = up_to(0.2);
    mischief.kill_worker = up_to(0.08);
    mischief.stop_worker = up_to(0.05);
    mischief.kill_coordinator = up_to(0.03);
    mischief.kill_engine = up_to(0.03);
    mischief.lose_queue = seed % 3 == 0 ? 0.5 : 0.0;
    mischief.fill_disk = seed % 7 == 0 ? 0.02 : 0.0;
    World world(seed, mischief);
    for (const char* name : {"a", "b", "c"}) world.add_worker(name);
    const JobSpec specs[] = {shared_job(), independent_job(), path_job(), tiles_job()};
    std::vector<JobSpec> jobs{specs[seed % 4]};
    if (seed % 5 == 0) jobs.push_back(specs[(seed + 1) % 4]);
    expect_the_single_nodes_images(world, jobs, seed);
    if (HasFailure()) return;
  }
}
INSTANTIATE_TEST_SUITE_P(Random, Seeds, testing::Range(0, 10));

TEST(Schedules, ALyingWorkerIsQuarantinedAndNamedAndItsSumsDoNotCount) {
  for (const Lie lie : {Lie::kWrongHash, Lie::kNanFigures}) {
    World world(3, {});
    world.add_worker("liar", lie);
    world.add_worker("honest");
    expect_the_single_nodes_images(world, {shared_job()}, static_cast<std::uint64_t>(lie));
    bool named = false;
    for (const WorkerView& worker : world.farm().workers())
      named = named || (worker.name == "liar" && worker.state == "quarantined");
    EXPECT_TRUE(named) << static_cast<int>(lie);
  }
}

TEST(Schedules, AWorkerOfAnotherBuildIsRefusedAndGetsNoUnit) {
  World world(4, {});
  world.add_worker("old", Lie::kOtherBuild);
  world.run_for(10);
  const std::string id = world.submit(shared_job());
  world.run_for(30);
  EXPECT_EQ(world.traced(), 0u);
  EXPECT_EQ(world.farm().show(id)->passes_done, 0u);
  world.add_worker("new");
  ASSERT_TRUE(world.run(kStuck));
  EXPECT_EQ(world.farm().show(id)->image_hash, hash_of_single_node(shared_job()));
}

TEST(Schedules, WorkersMayJoinAndLeaveInTheMiddleOfARound) {
  World world(5, {});
  world.add_worker("a");
  const std::string id = world.submit(shared_job());
  world.run_for(6);
  world.add_worker("b");
  world.run_for(3);
  world.kill_worker("a");
  ASSERT_TRUE(world.run(kStuck));
  EXPECT_EQ(world.farm().show(id)->image_hash, hash_of_single_node(shared_job()));
}

TEST(Schedules, AWorkerThatIsGoneForGoodWithAnEngineThatForgotHoldsUpNothing) {
  World world(9, {});
  for (const char* name : {"a", "b"}) world.add_worker(name);
  const std::string id = world.submit(shared_job());
  world.run_for(6);
  world.lose_worker("a");
  world.lose_queue();
  ASSERT_TRUE(world.run(120)) << world.describe();
  EXPECT_EQ(world.farm().show(id)->image_hash, hash_of_single_node(shared_job()));
}

TEST(Schedules, AJobsRadiiOutliveAnotherJobThatBeganWithTheSame) {
  World world(10, {});
  world.add_worker("a");
  JobSpec still = independent_job();
  still.stop.passes = 60;
  const std::string moving_id = world.submit(shared_job());
  const std::string still_id = world.submit(still);
  world.run_for(12);
  ASSERT_GT(world.farm().show(moving_id)->rounds, 1u);
  // It has not seen those radii yet.
  world.add_worker("b");
  ASSERT_TRUE(world.run(kStuck));
  EXPECT_EQ(world.farm().show(still_id)->units_repeated, 0u) << world.describe();
  EXPECT_EQ(world.farm().show(still_id)->image_hash, hash_of_single_node(still));
}

TEST(Schedules, AFullDiskHoldsAJobUpAndSaysSo) {
  World world(11, {});
  for (const char* name : {"a", "b"}) world.add_worker(name);
  const std::string id = world.submit(shared_job());
  world.run_for(0.02);
  world.fill_disk(true);
  world.run_for(30);
  // Nothing can be prepared on a full disk, nor fail for it.
  EXPECT_FALSE(has_ended(world.farm().show(id)->state));
  EXPECT_EQ(world.farm().show(id)->passes_done, 0u);
  world.fill_disk(false);
  world.run_for(10);
  const auto errors = [&] {
    const auto entries = world.farm().logs(id, 0).value();
    return std::count_if(entries.begin(), entries.end(), [](const LogEntry& entry) { return entry.level == "error"; });
  };
  const auto before = errors();
  world.fill_disk(true);
  world.run_for(20);
  EXPECT_EQ(world.farm().show(id)->state, JobState::kWaiting) << world.describe();
  EXPECT_NE(world.farm().show(id)->message, "");
  EXPECT_EQ(errors(), before + 1) << "that it waits is said once";
  world.fill_disk(false);
  ASSERT_TRUE(world.run(kStuck)) << world.describe();
  EXPECT_EQ(world.farm().show(id)->image_hash, hash_of_single_node(shared_job()));
}

TEST(Schedules, AJobStoppedByTimeHasTheBitsOfThatManyPasses) {
  World world(6, {});
  for (const char* name : {"a", "b"}) world.add_worker(name);
  JobSpec spec = shared_job();
  spec.stop.passes = 0;
  spec.stop.seconds = 9;
  const std::string id = world.submit(spec);
  ASSERT_TRUE(world.run(kStuck));
  const auto view = world.farm().show(id);
  ASSERT_GT(view->passes_done, 3u);
  spec.stop.passes = static_cast<int>(view->passes_done);
  EXPECT_EQ(view->image_hash, hash_of_single_node(spec));
}

TEST(Schedules, CancelKeepsTheImageSoFarAndLetsTheOthersGoOn) {
  World world(7, {});
  world.add_worker("a");
  const std::string first = world.submit(shared_job());
  const std::string second = world.submit(path_job());
  world.run_for(8);
  ASSERT_TRUE(world.farm().act(first, JobEvent::kCancel, "me"));
  EXPECT_EQ(world.farm().show(first)->state, JobState::kCancelled);
  EXPECT_TRUE(world.farm().artifact(first, Artifact::kExr));
  ASSERT_TRUE(world.run(kStuck));
  EXPECT_EQ(world.farm().show(second)->image_hash, hash_of_single_node(path_job()));
}

TEST(Schedules, TheCoordinatorGoesOnFromItsCheckpoint) {
  World world(8, {});
  for (const char* name : {"a", "b"}) world.add_worker(name);
  const std::string id = world.submit(shared_job());
  world.run_for(12);
  const auto before = world.farm().show(id)->passes_done;
  world.kill_coordinator();
  world.run_for(4);
  EXPECT_GT(world.farm().show(id)->passes_done, before / 2);
  ASSERT_TRUE(world.run(kStuck));
  EXPECT_EQ(world.farm().show(id)->image_hash, hash_of_single_node(shared_job()));
}

}  // namespace
}  // namespace pf::test
