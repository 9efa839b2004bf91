#pragma once

// A whole farm of real processes: nats-server, coordinator, workers; and what befalls them.

#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/wire/messages.h"
#include "jobs/child.h"
#include "jobs/service_client.h"
#include "tests/farm/engine_fixture.h"

namespace pf::farm_test {

/// A job of 48x48 pixels that one thread traces in a few seconds; its single node's image is the measure of all tests.
struct TestJob {
  std::string name = "box";
  int passes = 40;
  int photons = 20000;
  int priority = 50;
  std::string type = "sppm", mode = "shared";
  double checkpoint_seconds = 0.5;
  std::vector<std::string> more;  ///< further settings

  /// As arguments of --set for jobs/peer-box.toml.
  [[nodiscard]] std::vector<std::string> settings() const;
};

/// A worker in this process: the real session and renderer, with every message that it sends in the hands of the test.
class HandledWorker {
 public:
  /// Gets a message; what it returns is sent instead, in this order.
  using Handle = std::function<std::vector<wire::FromWorker>(const wire::FromWorker& message)>;
  struct Options {
    EngineOptions engine;
    std::filesystem::path cache;
    std::string build_id;
    Handle handle;
  };
  explicit HandledWorker(Options options);
  ~HandledWorker();

  /// Why the coordinator did not want this worker any more; empty as long as it does.
  [[nodiscard]] std::string refusal() const;

 private:
  void serve();

  Options options_;
  mutable std::mutex mutex_;
  std::string refusal_;
  std::atomic<bool> closing_{false};
  std::thread thread_;
};

class FarmFaults : public ::testing::Test {
 protected:
  /// Seconds that no test needs: beyond them something is stuck.
  static constexpr double kStuck = 90.0;

  void SetUp() override;
  /// Says what the processes said when the test failed.
  void TearDown() override;

  /// Starts engine, coordinator and `workers` workers (worker-1 ...).
  void start_farm(int workers);
  void start_engine();
  void start_coordinator();
  void start_worker(int number);
  [[nodiscard]] HandledWorker::Options handled(int number, HandledWorker::Handle handle) const;

  [[nodiscard]] std::string submit(const TestJob& job);
  [[nodiscard]] nlohmann::json show(const std::string& id);
  [[nodiscard]] bool has_ended(const std::string& id);
  [[nodiscard]] int passes_done(const std::string& id) { return show(id).value("passes_done", 0); }
  void cancel(const std::string& id);
  /// The JSON that a GET answers.
  [[nodiscard]] nlohmann::json ask(const std::string& path);
  [[nodiscard]] nlohmann::json farm_workers();
  /// All texts of the job's log.
  [[nodiscard]] std::string job_log(const std::string& id);
  /// Looks every few milliseconds; false when `seconds` did not suffice.
  [[nodiscard]] static bool wait_until(const std::function<bool()>& condition, double seconds = kStuck);
  void wait_for_passes(const std::string& id, int passes);
  /// Waits for the end and compares with `photonfarm render` of the same job.
  void expect_the_single_nodes_image(const std::string& id, const TestJob& job, double seconds = kStuck);
  [[nodiscard]] std::string hash_of_single_node(const TestJob& job);
  [[nodiscard]] std::string text_of(const std::string& log) const;

  TemporaryFolder folder_;
  std::filesystem::path state_;  ///< the coordinator's
  double ack_wait_ = 1.0;
  std::string address_;                     ///< that the engine listens on and all connect to; empty: loopback
  std::vector<std::string> worker_prefix_;  ///< program and arguments before the worker's own
  std::optional<NatsServer> server_;
  std::optional<Child> engine_, coordinator_;
  std::map<int, Child> workers_;

 private:
  [[nodiscard]] std::string engine_url() const;
  [[nodiscard]] Child start(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                            const std::string& log);
  [[nodiscard]] ServiceClient& client();
  std::unique_ptr<ServiceClient> client_;
  std::map<std::string, std::string> hashes_;
};

}  // namespace pf::farm_test
