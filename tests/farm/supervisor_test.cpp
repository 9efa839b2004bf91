// photonfarm farm: the real command and a real nats-server, over a coordinator and workers that are scripts.

#include <gtest/gtest.h>

#include <sys/stat.h>

#include <csignal>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include <fmt/format.h>

#include "tests/farm/engine_fixture.h"
#include "tests/support/paths.h"

namespace pf::farm_test {
namespace {

namespace fs = std::filesystem;

// Each writes `NAME PID` into a file of its own, then waits for signals.
constexpr const char* kCoordinator = R"(#!/bin/bash
while [ $# -gt 0 ]; do case $1 in --state) state=$2;; --credentials) credentials=$2;; esac; shift; done
trap 'echo coordinator stopped >>"$state/order"; exit 0' TERM
[ -r "$credentials" ] || exit 2
[ ! -e "$state/coordinator-fails" ] || exit 3
echo $$ >"$state/coordinator.started.tmp" && mv "$state/coordinator.started.tmp" "$state/coordinator.started"
echo http://127.0.0.1:1234 >"$state/url.tmp" && mv "$state/url.tmp" "$state/url"
while :; do read -r -t 1000 <>"$state/never"; done
)";
constexpr const char* kWorker = R"(#!/bin/bash
while [ $# -gt 0 ]; do case $1 in --name) name=$2;; --cache) state=${2%/cache};; --credentials) credentials=$2;; esac; shift; done
trap 'echo $name stopped >>"$state/order"; exit 0' TERM
[ -r "$credentials" ] || exit 2
[ ! -e "$state/$name-is-refused" ] || exit 2
echo $$ >"$state/$name.started.tmp" && mv "$state/$name.started.tmp" "$state/$name.started"
while :; do read -r -t 1000 <>"$state/never"; done
)";

bool is_alive(pid_t pid) {
  if (kill(pid, 0) != 0) return false;
  std::ifstream status(fmt::format("/proc/{}/stat", pid));
  std::string text;
  std::getline(status, text);
  const std::size_t end = text.rfind(')');
  return end != std::string::npos && text.size() > end + 2 && text[end + 2] != 'Z';
}

class Farm : public ::testing::Test {
 protected:
  void SetUp() override {
    bin_ = folder_.path() / "bin";
    state_ = folder_.path() / "state";
    fs::create_directories(bin_);
    fs::create_directories(state_);
    ASSERT_EQ(mkfifo((state_ / "never").c_str(), 0600), 0);
    // A copy: the command looks for its siblings where it lies itself.
    fs::copy_file(test::bin_dir() / "photonfarm", bin_ / "photonfarm");
    write_script("photonfarm-coordinator", kCoordinator);
    write_script("photonfarm-worker", kWorker);
  }
  void write_script(const char* name, const char* text) {
    std::ofstream(bin_ / name) << text;
    chmod((bin_ / name).c_str(), 0755);
  }
  Child start(std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"farm", "--state", state_.string(), "--workers", "2"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    auto child = Child::start({bin_ / "photonfarm", arguments, folder_.path() / "farm.log"});
    EXPECT_TRUE(child);
    return std::move(*child);
  }
  /// The pid that a service wrote, once it is another than `before`.
  pid_t wait_for(const std::string& name, pid_t before = 0) {
    pid_t pid = 0;
    const auto deadline = in(kPatience);
    while (steady_clock::now() < deadline) {
      std::ifstream(state_ / (name + ".started")) >> pid;
      if (pid != 0 && pid != before) return pid;
      wait_readable(-1, in(0.01));
    }
    ADD_FAILURE() << name << " did not start: " << log();
    return 0;
  }
  bool wait_until_gone(const std::set<pid_t>& pids) {
    const auto deadline = in(kPatience);
    for (const pid_t pid : pids) {
      while (is_alive(pid)) {
        if (steady_clock::now() > deadline) return false;
        wait_readable(-1, in(0.01));
      }
    }
    return true;
  }
  bool wait_for_log(const std::string& words) {
    const auto deadline = in(kPatience);
    while (log().find(words) == std::string::npos) {
      if (steady_clock::now() > deadline) return false;
      wait_readable(-1, in(0.01));
    }
    return true;
  }
  pid_t server_pid() {
    pid_t pid = 0;
    std::ifstream(state_ / "engine" / "nats-server.pid") >> pid;
    return pid;
  }
  std::string log() { return read_file(folder_.path() / "farm.log", 1 << 20).value_or(""); }

  TemporaryFolder folder_;
  fs::path bin_, state_;
};

TEST_F(Farm, RunsEverythingAndStopsWorkersFirst) {
  Child farm = start();
  const std::set<pid_t> pids = {wait_for("coordinator"), wait_for("worker-1"), wait_for("worker-2"), server_pid()};
  EXPECT_EQ(pids.size(), 4U);
  EXPECT_TRUE(wait_for_log("ready: http://127.0.0.1:1234"));
  kill(farm.pid(), SIGTERM);
  const auto end = farm.wait(in(kPatience));
  ASSERT_TRUE(end);
  EXPECT_EQ(end->exit_code, 0) << log();
  EXPECT_TRUE(wait_until_gone(pids));
  const std::string order = read_file(state_ / "order", 4096).value_or("");
  EXPECT_TRUE(order.ends_with("coordinator stopped\n")) << order;
  EXPECT_EQ(order.size(), std::string("worker-1 stopped\nworker-2 stopped\ncoordinator stopped\n").size()) << order;
}

TEST_F(Farm, StartsAgainWhatDies) {
  const Child farm = start();
  for (const char* name : {"worker-2", "coordinator"}) {
    const pid_t pid = wait_for(name);
    kill(pid, SIGKILL);
    const pid_t again = wait_for(name, pid);
    kill(again, SIGKILL);
    EXPECT_NE(wait_for(name, again), again);
  }
  const pid_t server = server_pid();
  ASSERT_TRUE(is_alive(server));
  kill(server, SIGKILL);
  const auto deadline = in(kPatience);
  while (server_pid() == server && steady_clock::now() < deadline) wait_readable(-1, in(0.01));
  EXPECT_TRUE(is_alive(server_pid()));
}

TEST_F(Farm, LeavesNoOrphanWhenItIsKilled) {
  Child farm = start();
  const std::set<pid_t> pids = {wait_for("coordinator"), wait_for("worker-1"), wait_for("worker-2"), server_pid()};
  kill(pids.size() == 4 ? *pids.begin() : 0, 0);
  kill(farm.pid(), SIGKILL);
  ASSERT_TRUE(farm.wait(in(kPatience)));
  EXPECT_TRUE(wait_until_gone(pids));
  Child again = start();  // the lock went with it
  EXPECT_NE(wait_for("coordinator"), 0);
  EXPECT_TRUE(wait_for_log("ready"));
}

TEST_F(Farm, IsRefusedASecondTimeInTheSameFolder) {
  const Child farm = start();
  wait_for("coordinator");
  Child second = start();
  const auto end = second.wait(in(kPatience));
  ASSERT_TRUE(end);
  EXPECT_EQ(end->exit_code, 2);
  EXPECT_NE(log().find(fmt::format("process {};", farm.pid())), std::string::npos) << log();
}

TEST_F(Farm, DoesNotStartAWorkerAgainThatIsRefused) {
  std::ofstream(state_ / "worker-1-is-refused");
  Child farm = start();
  EXPECT_TRUE(wait_for_log("worker-1 exited with code 2 and is not started again"));
  EXPECT_TRUE(is_alive(wait_for("worker-2")));
  EXPECT_TRUE(is_alive(farm.pid()));
}

TEST_F(Farm, EndsWhenEveryWorkerIsRefusedOrTheCoordinatorCannotRun) {
  std::ofstream(state_ / "worker-1-is-refused");
  std::ofstream(state_ / "worker-2-is-refused");
  Child farm = start();
  auto end = farm.wait(in(kPatience));
  ASSERT_TRUE(end);
  EXPECT_EQ(end->exit_code, 2) << log();
  fs::remove(state_ / "worker-1-is-refused");
  std::ofstream(state_ / "coordinator-fails");
  Child second = start();
  end = second.wait(in(kPatience));
  ASSERT_TRUE(end);
  EXPECT_EQ(end->exit_code, 3) << log();
}

TEST_F(Farm, SaysWhatIsMissing) {
  fs::remove(bin_ / "photonfarm-worker");
  Child farm = start();
  const auto end = farm.wait(in(kPatience));
  ASSERT_TRUE(end);
  EXPECT_EQ(end->exit_code, 4);
  EXPECT_NE(log().find("photonfarm-worker: cannot be started"), std::string::npos) << log();
  EXPECT_FALSE(is_alive(server_pid()));
}

TEST_F(Farm, ASecondSignalDoesNotWait) {
  write_script("photonfarm-worker",
               "#!/bin/bash\ntrap '' TERM\nwhile [ $# -gt 0 ]; do case $1 in --name) name=$2;; "
               "--cache) state=${2%/cache};; esac; shift; done\n"
               "echo $$ >\"$state/$name.started\"\nwhile :; do read -r -t 1000 <>\"$state/never\"; done\n");
  Child farm = start();
  wait_for("worker-1");
  wait_for("worker-2");
  const auto begin = steady_clock::now();
  kill(farm.pid(), SIGINT);
  EXPECT_FALSE(farm.wait(in(0.5)));
  kill(farm.pid(), SIGINT);
  ASSERT_TRUE(farm.wait(in(kPatience)));
  EXPECT_LT(seconds_since(begin), 20.0);
  EXPECT_TRUE(wait_for_log("worker-1 is killed"));
}

}  // namespace
}  // namespace pf::farm_test
