// A cut between hosts, longer than AckWait and all time limits of the connection.

#include <sched.h>
#include <unistd.h>

#include <cstring>

#include "tests/farm/farm_fixture.h"

namespace pf::farm_test {
namespace {

constexpr const char* kHere = "10.213.0.1";
constexpr const char* kThere = "10.213.0.2";

/// This process's threads and children in a network of their own, and another host beside it: a namespace that a
/// sleeping process holds. Nothing is left of either when the processes are gone.
class NetworkCut : public FarmFaults {
 protected:
  void SetUp() override {
    FarmFaults::SetUp();
    if (IsSkipped()) return;
    ip_ = find_program("ip", "/usr/sbin:/sbin:/usr/bin:/bin");
    const auto nsenter = find_program("nsenter", "/usr/bin:/bin");
    const auto unshare = find_program("unshare", "/usr/bin:/bin");
    if (ip_.empty() || nsenter.empty() || unshare.empty()) GTEST_SKIP() << "no ip, nsenter or unshare here";
    if (::unshare(CLONE_NEWNET) != 0) GTEST_SKIP() << "a network namespace is not permitted: " << std::strerror(errno);
    auto host = Child::start({unshare, {"--net", "sleep", "600"}, folder_.path() / "host.log"});
    ASSERT_TRUE(host) << host.error().message;
    host_.emplace(std::move(*host));
    const std::string pid = std::to_string(host_->pid());
    const auto of = [](const std::string& process) {
      return std::filesystem::read_symlink("/proc/" + process + "/ns/net");
    };
    ASSERT_TRUE(wait_until(
        [&] { return of(pid) != of(std::to_string(::gettid())) && of(pid) != of(std::to_string(::getppid())); },
        kPatience));
    worker_prefix_ = {nsenter.string(), "-t", pid, "-n"};
    run({"link", "set", "lo", "up"});
    run({"link", "add", "here", "type", "veth", "peer", "name", "there", "netns", pid});
    if (IsSkipped()) return;
    run({"address", "add", std::string(kHere) + "/24", "dev", "here"});
    run({"link", "set", "here", "up"});
    run_there({"address", "add", std::string(kThere) + "/24", "dev", "there"});
    run_there({"link", "set", "lo", "up"});
    run_there({"link", "set", "there", "up"});
    address_ = kHere;
  }
  void run(const std::vector<std::string>& arguments) { expect_success(ip_, arguments); }
  void run_there(const std::vector<std::string>& arguments) {
    std::vector<std::string> words(worker_prefix_.begin() + 1, worker_prefix_.end());
    words.push_back(ip_.string());
    words.insert(words.end(), arguments.begin(), arguments.end());
    expect_success(worker_prefix_.front(), words);
  }
  void cut(bool cut) { run({"link", "set", "here", cut ? "down" : "up"}); }

 private:
  void expect_success(const std::filesystem::path& program, const std::vector<std::string>& arguments) {
    const auto child = run_and_capture(program, arguments, kPatience);
    if (!child || child->end.exit_code != 0) GTEST_SKIP() << "a network between namespaces is not permitted here";
  }
  std::filesystem::path ip_;
  std::optional<Child> host_;
};

TEST_F(NetworkCut, AHostThatWasCutOffGoesOnAndNothingCountsTwice) {
  start_farm(0);
  start_worker(1);
  start_worker(2);
  worker_prefix_.clear();
  TestJob job;
  job.passes = 60;
  const std::string id = submit(job);
  wait_for_passes(id, 5);
  cut(true);
  // Both workers are beyond the cut: nothing moves until the coordinator has given them up.
  ASSERT_TRUE(wait_until([&] {
    const auto workers = farm_workers();
    return std::all_of(workers.begin(), workers.end(), [](const auto& w) { return w.value("state", "") == "lost"; });
  }));
  cut(false);
  expect_the_single_nodes_image(id, job);
}

TEST_F(NetworkCut, TheOthersFinishWithoutAHostThatIsCutOffForGood) {
  start_farm(0);
  start_worker(1);
  worker_prefix_.clear();
  start_worker(2);
  TestJob job;
  job.passes = 60;
  const std::string id = submit(job);
  wait_for_passes(id, 5);
  cut(true);
  expect_the_single_nodes_image(id, job);
}

}  // namespace
}  // namespace pf::farm_test
