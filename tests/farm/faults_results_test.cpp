// Workers whose messages are damaged, repeated, lost, or lies: what comes in right counts, and liars are named.

#include <limits>
#include <random>

#include "build_id.h"
#include "tests/farm/farm_fixture.h"
#include "tests/support/paths.h"

namespace pf::farm_test {
namespace {

using Messages = std::vector<wire::FromWorker>;

std::string state_of(const nlohmann::json& workers, const std::string& name) {
  for (const auto& worker : workers) {
    if (worker.value("name", "") == name) return worker.value("state", "") + ": " + worker.value("message", "");
  }
  return "not there";
}

/// Damages, repeats, loses and withholds messages by seed.
class BadLine {
 public:
  explicit BadLine(std::uint64_t seed) : rng_(seed) {}
  Messages operator()(const wire::FromWorker& message) {
    Messages out;
    if (chance(0.1)) {
      ++*lost;
    } else {
      out.push_back(message);
    }
    if (chance(0.15)) out.push_back(message);
    if (message.has_chunk() && !message.chunk().data().empty() && chance(0.3)) {
      wire::FromWorker bad = message;
      std::string& data = *bad.mutable_chunk()->mutable_data();
      data[std::uniform_int_distribution<std::size_t>(0, data.size() - 1)(rng_)] ^= 0x10;
      out.insert(out.begin(), bad);
      ++*damaged;
    }
    // Late: after what comes next.
    std::swap(out, late_);
    if (!chance(0.1)) {
      out.insert(out.end(), late_.begin(), late_.end());
      late_.clear();
    }
    return out;
  }
  std::shared_ptr<std::atomic<int>> lost = std::make_shared<std::atomic<int>>(0);
  std::shared_ptr<std::atomic<int>> damaged = std::make_shared<std::atomic<int>>(0);

 private:
  bool chance(double p) { return std::uniform_real_distribution(0.0, 1.0)(rng_) < p; }
  std::mt19937_64 rng_;
  Messages late_;
};

TEST_F(FarmFaults, DamagedRepeatedAndLostChunksAreSentAgain) {
  start_farm(1);
  const BadLine line(5);
  const HandledWorker worker(handled(2, line));
  TestJob job;
  job.passes = 60;
  const std::string id = submit(job);
  expect_the_single_nodes_image(id, job);
  EXPECT_GT(*line.damaged, 0);
  EXPECT_GT(*line.lost, 0);
  EXPECT_EQ(state_of(farm_workers(), "worker-2").find("quarantined"), std::string::npos) << "a bad line is no lie";
}

TEST_F(FarmFaults, AFarmOfOneWorkerOnABadLineIsOnlySlow) {
  start_farm(0);
  const BadLine line(6);
  const HandledWorker worker(handled(1, line));
  TestJob job;
  job.passes = 12;
  const std::string id = submit(job);
  expect_the_single_nodes_image(id, job);
}

TEST_F(FarmFaults, AWorkerThatReturnsNanOrAWrongHashIsQuarantinedAndNamed) {
  start_farm(0);
  const HandledWorker nan(handled(2, [](const wire::FromWorker& message) {
    Messages out{message};
    if (message.has_result() && message.result().kind() == wire::Task::SUB_PASSES) {
      out[0].mutable_result()->set_trace_seconds(std::numeric_limits<double>::quiet_NaN());
    }
    return out;
  }));
  const HandledWorker wrong(handled(3, [](const wire::FromWorker& message) {
    Messages out{message};
    if (message.has_result() && message.result().kind() == wire::Task::SUB_PASSES)
      (*out[0].mutable_result()->mutable_content())[5] ^= 4;
    return out;
  }));
  const TestJob job;
  const std::string id = submit(job);
  // Nobody but the two: both lie before an honest one comes.
  EXPECT_TRUE(wait_until([&] { return !nan.refusal().empty() && !wrong.refusal().empty(); }, 30.0))
      << "2: " << nan.refusal() << "; 3: " << wrong.refusal() << farm_workers().dump(2) << job_log(id);
  EXPECT_EQ(passes_done(id), 0);
  start_worker(1);
  expect_the_single_nodes_image(id, job);
  for (const char* name : {"worker-2", "worker-3"}) {
    EXPECT_EQ(state_of(farm_workers(), name).find("quarantined: "), 0U) << state_of(farm_workers(), name);
    EXPECT_NE(job_log(id).find(std::string(name) + " is in quarantine"), std::string::npos) << job_log(id);
  }
  const auto listed =
      run_and_capture(test::bin_dir() / "photonfarm", {"workers", "--server", state_.string()}, kPatience);
  ASSERT_TRUE(listed) << listed.error().message;
  EXPECT_NE(listed->output.find("quarantined"), std::string::npos) << listed->output;
}

TEST_F(FarmFaults, RadiiThatAreNotWhatWasAnnouncedAreNotUsed) {
  start_farm(0);
  const HandledWorker wrong(handled(2, [](const wire::FromWorker& message) {
    Messages out{message};
    if (message.has_result()) (*out[0].mutable_result()->mutable_content())[0] ^= 1;
    return out;
  }));
  TestJob job;
  job.passes = 10;
  const std::string id = submit(job);
  EXPECT_TRUE(wait_until([&] { return !wrong.refusal().empty(); }, 30.0)) << job_log(id);
  start_worker(1);
  expect_the_single_nodes_image(id, job, 30.0);
  EXPECT_NE(job_log(id).find("worker-2 is in quarantine"), std::string::npos) << job_log(id);
}

TEST_F(FarmFaults, AWorkerOfAnotherBuildIsRefusedAndToldBothBuilds) {
  start_farm(0);
  auto options = handled(2, {});
  options.build_id = "0.0.9-of-yesterday";
  const HandledWorker old(options);
  TestJob job;
  job.passes = 10;
  const std::string id = submit(job);
  ASSERT_TRUE(wait_until([&] { return !old.refusal().empty(); }, kPatience));
  EXPECT_NE(old.refusal().find("0.0.9-of-yesterday"), std::string::npos) << old.refusal();
  EXPECT_NE(old.refusal().find(kBuildId), std::string::npos) << old.refusal();
  EXPECT_NE(text_of("coordinator").find("0.0.9-of-yesterday"), std::string::npos);
  EXPECT_EQ(passes_done(id), 0);
  start_worker(1);
  expect_the_single_nodes_image(id, job);
}

TEST_F(FarmFaults, AResultUnderTheNameOfAnotherBuildIsNotTaken) {
  start_farm(0);
  std::atomic<int> sent = 0;
  // Passes itself off as of this build until it has something to hand in.
  const HandledWorker sly(handled(2, [&sent](const wire::FromWorker& message) {
    Messages out{message};
    if (message.has_result() && sent < 3) out[0].mutable_result()->set_build_id("another"), ++sent;
    return out;
  }));
  TestJob job;
  job.passes = 10;
  const std::string id = submit(job);
  ASSERT_TRUE(wait_until([&] { return sent > 0; }, kPatience));
  start_worker(1);
  expect_the_single_nodes_image(id, job);
}

}  // namespace
}  // namespace pf::farm_test
