#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "common/base/event_queue.h"
#include "common/base/log.h"
#include "common/wire/nats/engine.h"
#include "coordinator/farm.h"
#include "coordinator/job_service.h"

namespace pf {

/// The farm on a thread of its own: events of the engine and questions of users stand in one queue, and the thread
/// answers one after the other. The questions' side may be called from any thread.
class FarmProcess final : public JobService {
 public:
  struct Options {
    EngineOptions engine;
    std::filesystem::path state;
    std::uint64_t incarnation = 1;
    Metrics* metrics = nullptr;  ///< where work is counted
    RetentionPolicy retention;
    std::uint64_t jobs_per_token = CoordinatorConfig::Limits().jobs_per_token;
  };
  /// Connects and takes up the state folder's jobs. Errors: kUnavailable (engine), kUsage (folder).
  [[nodiscard]] static Result<std::unique_ptr<FarmProcess>> open(const Options& options, const Log& log);
  ~FarmProcess() override;

  /// Serves until `interrupted`; then saves checkpoints. Error: the engine refused this process for good.
  [[nodiscard]] Result<void> run(const std::atomic<bool>& interrupted);
  /// No question is answered any more; those that wait get kInterrupted.
  void close();

  [[nodiscard]] Result<JobView> submit(const Submission& submission) override;
  [[nodiscard]] Result<Validation> validate(const Submission& submission) override;
  [[nodiscard]] Result<JobList> list(const JobFilter& filter) override;
  [[nodiscard]] Result<JobView> show(const std::string& id) override;
  [[nodiscard]] Result<JobView> act(const std::string& id, JobEvent verb, const std::string& by) override;
  [[nodiscard]] Result<JobView> extend(const std::string& id, const StopChange& stops, const std::string& by) override;
  [[nodiscard]] Result<JobView> change(const std::string& id, const JobChange& change, const std::string& by) override;
  [[nodiscard]] Result<void> remove(const std::string& id, const std::string& by) override;
  [[nodiscard]] Result<UnitPage> units(const std::string& id, std::optional<std::uint64_t> after) override;
  [[nodiscard]] Result<std::vector<ConvergencePoint>> convergence(const std::string& id) override;
  [[nodiscard]] Result<Estimate> estimate(const std::string& id, const EstimateRequest& request) override;
  [[nodiscard]] Result<std::filesystem::path> artifact(const std::string& id, Artifact kind) override;
  [[nodiscard]] Result<std::string> preview_png(const std::string& id) override;
  [[nodiscard]] Result<LayerList> layers(const std::string& id) override;
  [[nodiscard]] Result<LayerPixels> pixels(const std::string& id, const std::string& layer, int max_width) override;
  [[nodiscard]] Result<std::vector<LogEntry>> logs(const std::string& id, std::uint64_t after) override;
  [[nodiscard]] std::vector<WorkerView> workers() override;
  [[nodiscard]] Result<WorkerView> steer(const std::string& worker, WorkerVerb verb, const std::string& by) override;
  [[nodiscard]] std::uint64_t wait_for_change(std::uint64_t version, double seconds) override;

 private:
  using Asked = std::function<void(Farm&)>;
  using Event = std::variant<EngineEvent, Asked>;

  explicit FarmProcess(const Log& log);
  [[nodiscard]] Result<void> handle(EngineEvent& event);
  void publish_version();
  /// Asks on the farm's thread and waits. The question returns a Result, or what an empty answer may stand for.
  template <typename Question>
  [[nodiscard]] auto ask(Question question) -> std::invoke_result_t<Question, Farm&>;

  const Log& log_;
  SystemClock clock_;
  EventQueue<Event> events_;
  std::unique_ptr<NatsCoordinatorPort> port_;
  std::unique_ptr<BlobStore> blobs_;
  std::unique_ptr<Farm> farm_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t version_ = 1;
  bool closed_ = false;
};

}  // namespace pf
