// Many small jobs while workers and the coordinator are killed at random: all end, none twice, none is lost, and what
// the API took meanwhile. PHOTONFARM_STORM_JOBS (20) says how many; tests/farm/storm runs it with 1000.

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <random>
#include <set>

#include <fmt/format.h>

#include "build_id.h"
#include "coordinator/store/job_store.h"
#include "jobs/state_doctor.h"
#include "tests/farm/farm_fixture.h"

namespace pf::farm_test {
namespace {

using std::uniform_real_distribution;

/// Asks this and that all the time, as watchers do, and keeps what each answer took.
class Prober {
 public:
  explicit Prober(const std::filesystem::path& state) : client_(options(state)), thread_([this] { probe(); }) {}
  ~Prober() { stop(); }
  void stop() {
    stopping_.store(true);
    if (thread_.joinable()) thread_.join();
  }
  /// Of those that were answered; milliseconds.
  [[nodiscard]] double percentile(double part) {
    if (milliseconds_.empty()) return 0;
    std::sort(milliseconds_.begin(), milliseconds_.end());
    return milliseconds_[static_cast<std::size_t>(part * static_cast<double>(milliseconds_.size() - 1))];
  }
  [[nodiscard]] std::size_t answers() const { return milliseconds_.size(); }
  [[nodiscard]] std::size_t refusals() const { return refusals_; }

 private:
  [[nodiscard]] static ServiceOptions options(const std::filesystem::path& state) {
    ServiceOptions options;
    options.server = state.string();
    return options;
  }
  void probe() {
    const std::vector<std::string> paths{"/v1/jobs?limit=20", "/v1/workers", "/v1/jobs/storm-0-1",
                                         "/v1/jobs/storm-0-1/logs", "/v1/jobs?state=running"};
    for (std::size_t i = 0; !stopping_.load(); ++i) {
      const auto begin = steady_clock::now();
      const auto reply = client_.try_call({.path = paths[i % paths.size()]});
      // While the coordinator is dead nobody answers; that is not what is measured.
      if (reply && reply->status == 200) milliseconds_.push_back(1e3 * seconds_since(begin));
      if (reply && reply->status >= 500) ++refusals_;
      wait_readable(-1, in(0.02));
    }
  }

  ServiceClient client_;
  std::atomic<bool> stopping_{false};
  std::vector<double> milliseconds_;
  std::size_t refusals_ = 0;
  std::thread thread_;
};

class Storm : public FarmFaults {
 protected:
  static constexpr int kKinds = 4;  ///< of jobs, by their seed
  [[nodiscard]] static int jobs() {
    const char* wanted = std::getenv("PHOTONFARM_STORM_JOBS");
    return wanted != nullptr ? std::max(1, std::atoi(wanted)) : 20;
  }
  [[nodiscard]] static TestJob tiny(int number) {
    TestJob job;
    job.name = fmt::format("storm-{}", number % kKinds);
    job.passes = 3;
    job.photons = 500;
    job.priority = 40 + 10 * (number % 3);
    job.more = {"image.width=16", "image.height=16", fmt::format("integrator.seed={}", 1 + number % kKinds)};
    return job;
  }
  void kill_somebody(std::mt19937_64& rng) {
    const int victim = std::uniform_int_distribution(0, 4)(rng);
    ++kills_;
    if (victim == 0) {
      coordinator_->signal(SIGKILL);
      ASSERT_TRUE(coordinator_->wait(in(kPatience)));
      start_coordinator();
    } else {
      workers_.at(1 + victim % 2).signal(SIGKILL);
      ASSERT_TRUE(workers_.at(1 + victim % 2).wait(in(kPatience)));
      start_worker(1 + victim % 2);
    }
  }
  [[nodiscard]] bool all_ended() {
    std::map<std::string, int> counts;
    std::string before;
    do {
      const auto page = ask("/v1/jobs?limit=1000" + (before.empty() ? "" : "&before=" + before));
      for (const auto& job : page.at("jobs")) ++counts[job.value("state", "")];
      before = page.at("before").is_null() ? "" : page.at("before").get<std::string>();
    } while (!before.empty());
    return counts["done"] + counts["failed"] + counts["cancelled"] == jobs();
  }
  int kills_ = 0;
};

TEST_F(Storm, EveryJobEndsOnceWhoeverIsKilled) {
  start_farm(2);
  std::mt19937_64 rng(11);
  Prober prober(state_);
  const auto begin = steady_clock::now();
  std::set<std::string> ids;
  auto next_kill = in(0.5);
  const auto disturb = [&] {
    if (steady_clock::now() < next_kill) return;
    kill_somebody(rng);
    next_kill = in(uniform_real_distribution(0.5, 4.0)(rng));
  };
  for (int i = 0; i < jobs(); ++i) {
    ids.insert(submit(tiny(i)));
    disturb();
  }
  EXPECT_EQ(ids.size(), static_cast<std::size_t>(jobs()))
      << "a submission that is repeated is the same job, another one is not";
  const double patience = kStuck + 4.0 * jobs();
  ASSERT_TRUE(wait_until(
      [&] {
        disturb();
        return all_ended();
      },
      patience))
      << "stuck";
  prober.stop();
  const double seconds = seconds_since(begin);
  std::map<std::string, std::string> hashes;
  for (const std::string& id : ids) {
    const auto job = show(id);
    EXPECT_EQ(job.value("state", ""), "done") << job.dump(2) << job_log(id);
    const auto [known, is_new] = hashes.emplace(job.value("name", ""), job.value("image_hash", ""));
    EXPECT_EQ(job.value("image_hash", ""), known->second) << id;
  }
  EXPECT_EQ(hashes.at("storm-0"), hash_of_single_node(tiny(0)));
  coordinator_.reset();
  const auto store = JobStore::open(state_ / JobStore::kFileName);
  ASSERT_TRUE(store) << store.error().message;
  const auto loaded = store->load();
  ASSERT_TRUE(loaded);
  EXPECT_EQ(loaded->records.size(), ids.size()) << "none is lost";
  for (const JobRecord& job : loaded->records) {
    int completed = 0;
    const auto transitions = store->transitions(job.number);
    for (const Transition& t : *transitions) completed += t.event == JobEvent::kComplete ? 1 : 0;
    EXPECT_EQ(completed, 1) << job.id << " ended so often";
    std::uint64_t next = 0;
    const auto units = store->units(job.number, 0, 1000);
    for (const UnitView& unit : *units) {
      EXPECT_EQ(unit.first, next) << job.id;
      next = unit.first + unit.count;
    }
    EXPECT_EQ(next, 3u) << job.id << ": every sub-pass counts once";
  }
  std::cout << fmt::format(
      "{} jobs in {:.1f} s, {} killed; API: {} answers, {} refusals, median {:.1f} ms, 99th percentile {:.1f} ms\n",
      jobs(), seconds, kills_, prober.answers(), prober.refusals(), prober.percentile(0.5), prober.percentile(0.99));
}

TEST_F(Storm, AfterIsAllWellTheDoctorSays) {
  start_farm(1);
  const std::string id = submit(tiny(0));
  ASSERT_TRUE(wait_until([&] { return has_ended(id); }));
  const auto working = examine_state(state_, folder_.path(), kBuildId);
  ASSERT_TRUE(working) << working.error().message;
  EXPECT_TRUE(all_well(*working)) << "beside the farm: " << doctor_text(*working, "", "");
  coordinator_->signal(SIGKILL);
  ASSERT_TRUE(coordinator_->wait(in(kPatience)));
  const auto dead = examine_state(state_, folder_.path(), kBuildId);
  ASSERT_TRUE(dead) << dead.error().message;
  EXPECT_TRUE(all_well(*dead)) << "after a kill: " << doctor_text(*dead, "", "");
  start_coordinator();
  EXPECT_EQ(show(id).value("state", ""), "done");
}

}  // namespace
}  // namespace pf::farm_test
