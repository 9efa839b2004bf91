// Every method on a farm: tiles, sample ranges and photon blocks, the same image as the single node's.

#include <csignal>

#include "tests/farm/farm_fixture.h"

namespace pf::farm_test {
namespace {

TestJob job_of(const std::string& type) {
  TestJob job;
  job.name = type;
  job.type = type;
  job.passes = 8;
  job.photons = 10000;
  job.more = {"photon_map.caustic_photons=10000", "final_gather.rays=32", "irradiance_cache.rays=32",
              "ppm.eye_samples=2"};
  return job;
}

TEST_F(FarmFaults, EveryMethodGivesTheSingleNodesImageThoughAWorkerIsKilled) {
  start_farm(2);
  for (const std::string type : {"path", "photon_map", "final_gather", "irradiance_cache", "photon_splat", "ppm"}) {
    const TestJob job = job_of(type);
    const std::string id = submit(job);
    wait_for_passes(id, 1);
    workers_.at(2).signal(SIGKILL);
    ASSERT_TRUE(workers_.at(2).wait(in(kPatience)));
    start_worker(2);
    expect_the_single_nodes_image(id, job);
    if (HasFailure()) return;
  }
}

TEST_F(FarmFaults, ACacheFileIsRefusedWithAReason) {
  start_farm(1);
  TestJob job = job_of("irradiance_cache");
  job.more.emplace_back("cache.file=a.pfcache");
  const std::string id = submit(job);
  ASSERT_TRUE(wait_until([&] { return has_ended(id); }));
  EXPECT_EQ(show(id).value("state", ""), "failed");
  EXPECT_NE(show(id).value("message", "").find("cache.file"), std::string::npos) << show(id).dump();
}

}  // namespace
}  // namespace pf::farm_test
