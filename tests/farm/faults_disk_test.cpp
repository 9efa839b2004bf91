// A full disk: the job says so and waits, and goes on when there is space.

#include <sched.h>
#include <sys/mount.h>
#include <sys/resource.h>

#include <csignal>
#include <cstring>
#include <fstream>
#include <regex>

#include "tests/farm/farm_fixture.h"

namespace pf::farm_test {
namespace {

/// No file that the process writes may grow beyond this from now on; 0: no bound.
void limit_files(const Child& child, rlim_t bytes) {
  const ::rlimit limit{bytes == 0 ? RLIM_INFINITY : bytes, RLIM_INFINITY};
  ASSERT_EQ(::prlimit(child.pid(), RLIMIT_FSIZE, &limit, nullptr), 0) << std::strerror(errno);
}

/// A small disk of memory, visible to this process and its children only, gone with them.
class SmallDisk {
 public:
  /// Empty when it is not permitted.
  static std::unique_ptr<SmallDisk> mount(const std::filesystem::path& folder, const char* size) {
    if (::unshare(CLONE_NEWNS) != 0) return nullptr;
    if (::mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0) return nullptr;
    if (::mount("small", folder.c_str(), "tmpfs", 0, (std::string("size=") + size).c_str()) != 0) return nullptr;
    return std::unique_ptr<SmallDisk>(new SmallDisk(folder));
  }
  ~SmallDisk() { ::umount2(folder_.c_str(), MNT_DETACH); }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  void fill() const {
    std::ofstream file(folder_ / "filler", std::ios::binary);
    const std::string block(4096, 'x');
    while (file.write(block.data(), static_cast<std::streamsize>(block.size())).flush()) {
    }
  }
  void empty() const { std::filesystem::remove(folder_ / "filler"); }

 private:
  explicit SmallDisk(std::filesystem::path folder) : folder_(std::move(folder)) {}
  std::filesystem::path folder_;
};

class FullDisk : public FarmFaults {
 protected:
  void expect_to_wait(const std::string& id, const std::string& reason) {
    ASSERT_TRUE(wait_until([&] { return show(id).value("state", "") == "waiting"; }, kPatience)) << show(id).dump(2);
    const std::regex pattern(reason);
    EXPECT_TRUE(std::regex_search(show(id).value("message", ""), pattern)) << show(id).value("message", "");
    EXPECT_TRUE(std::regex_search(job_log(id), pattern)) << job_log(id);
  }
  /// Which file meets the limit first, a checkpoint or the database, is chance.
  static constexpr const char* kCannotGrow = "too large|size of files";
};

TEST_F(FullDisk, AJobWhoseFilesCannotGrowWaitsAndGoesOn) {
  start_farm(2);
  const TestJob job;
  const std::string id = submit(job);
  wait_for_passes(id, 10);
  limit_files(*coordinator_, 4096);
  expect_to_wait(id, kCannotGrow);
  limit_files(*coordinator_, 0);
  expect_the_single_nodes_image(id, job);
  EXPECT_NE(job_log(id).find("there is space again"), std::string::npos) << job_log(id);
}

TEST_F(FullDisk, BeforeTheFirstRound) {
  start_farm(0);
  const TestJob job;
  const std::string id = submit(job);
  // Neither the database nor the radii and the first checkpoint can be written.
  limit_files(*coordinator_, 20000);
  start_worker(1);
  expect_to_wait(id, "size of files");
  limit_files(*coordinator_, 0);
  expect_the_single_nodes_image(id, job);
}

TEST_F(FullDisk, WhenTheImageIsWritten) {
  start_farm(2);
  TestJob job;
  job.passes = 20;
  // Too seldom to matter before the end.
  job.checkpoint_seconds = 3600;
  job.mode = "independent";
  const std::string id = submit(job);
  wait_for_passes(id, 1);
  limit_files(*coordinator_, 100000);
  expect_to_wait(id, "");
  limit_files(*coordinator_, 0);
  expect_the_single_nodes_image(id, job);
}

TEST_F(FullDisk, ARealOneToo) {
  const auto disk = SmallDisk::mount(state_, "8m");
  if (!disk) GTEST_SKIP() << "mounting a small disk is not permitted here: " << std::strerror(errno);
  start_farm(2);
  TestJob job;
  job.passes = 60;
  const std::string id = submit(job);
  for (const int passes : {5, 25}) {
    wait_for_passes(id, passes);
    disk->fill();
    expect_to_wait(id, "No space left");
    disk->empty();
    ASSERT_TRUE(wait_until([&] { return show(id).value("state", "") != "waiting"; }, kPatience));
  }
  expect_the_single_nodes_image(id, job);
  coordinator_.reset();  // before the disk goes
}

TEST_F(FullDisk, ACoordinatorThatIsKilledWhileItWaitsGoesOnToo) {
  start_farm(2);
  const TestJob job;
  const std::string id = submit(job);
  wait_for_passes(id, 10);
  limit_files(*coordinator_, 4096);
  expect_to_wait(id, kCannotGrow);
  coordinator_->signal(SIGKILL);
  ASSERT_TRUE(coordinator_->wait(in(kPatience)));
  start_coordinator();
  expect_the_single_nodes_image(id, job);
}

TEST_F(FullDisk, AWorkersOwnIsNotTheJobsFault) {
  start_farm(1);
  limit_files(workers_.at(1), 4096);
  const TestJob job;
  const std::string id = submit(job);
  ASSERT_TRUE(wait_until([&] { return job_log(id).find("worker-1") != std::string::npos; }, kPatience)) << job_log(id);
  start_worker(2);
  limit_files(workers_.at(1), 0);
  expect_the_single_nodes_image(id, job);
}

}  // namespace
}  // namespace pf::farm_test
