#include "coordinator/farm_process.h"

#include <chrono>

#include "build_id.h"

namespace pf {
namespace {

constexpr std::size_t kMaxEvents = 4096;
/// Messages that wait for the farm's thread; beyond, the engine's buffers fill and workers repeat what got
/// lost.
constexpr std::size_t kMaxEventBytes = std::size_t{32} << 20;
constexpr std::chrono::milliseconds kTick{100};

std::int64_t unix_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

Error closing() { return {ErrorKind::kInterrupted, "the coordinator is shutting down"}; }

}  // namespace

FarmProcess::FarmProcess(const Log& log) : log_(log), events_(kMaxEvents, kMaxEventBytes) {}

FarmProcess::~FarmProcess() { close(); }

Result<std::unique_ptr<FarmProcess>> FarmProcess::open(const Options& options, const Log& log) {
  std::unique_ptr<FarmProcess> process(new FarmProcess(log));
  auto blobs = BlobStore::open(options.state / "blobs", 0);
  if (!blobs) return tl::unexpected(blobs.error());
  process->blobs_ = std::make_unique<BlobStore>(std::move(*blobs));
  auto port = NatsCoordinatorPort::connect(options.engine, [events = &process->events_](EngineEvent event) {
    const std::size_t bytes = bytes_of(event);
    events->push(Event(std::move(event)), bytes);
  });
  if (!port) return tl::unexpected(port.error());
  process->port_ = std::move(*port);
  FarmOptions farm;
  farm.state = options.state;
  farm.build_id = kBuildId;
  farm.ack_wait_seconds = options.engine.ack_wait_seconds;
  farm.incarnation = options.incarnation;
  farm.metrics = options.metrics;
  farm.retention = options.retention;
  farm.jobs_per_token = options.jobs_per_token;
  process->farm_ =
      std::make_unique<Farm>(std::move(farm), *process->port_, *process->blobs_, process->clock_, unix_ms, log);
  if (auto restored = process->farm_->restore(); !restored) {
    process->close();
    return tl::unexpected(restored.error());
  }
  return process;
}

void FarmProcess::close() {
  events_.close();
  const std::lock_guard lock(mutex_);
  closed_ = true;
  changed_.notify_all();
}

Result<void> FarmProcess::handle(EngineEvent& event) {
  if (const auto* message = std::get_if<MessageArrived>(&event)) {
    farm_->on_message(message->worker, message->bytes);
  } else if (const auto* change = std::get_if<ConnectionChanged>(&event)) {
    log_.info("engine", {{"up", change->up ? "yes" : "no"}, {"text", change->text}});
    if (change->lost) return fail(ErrorKind::kUnavailable, change->text);
    if (change->up) farm_->on_connected();
  } else if (const auto* problem = std::get_if<EngineProblem>(&event)) {
    log_.warning("engine", {{"problem", problem->text}});
  }
  return {};
}

void FarmProcess::publish_version() {
  const std::lock_guard lock(mutex_);
  if (farm_->version() == version_) return;
  version_ = farm_->version();
  changed_.notify_all();
}

Result<void> FarmProcess::run(const std::atomic<bool>& interrupted) {
  farm_->on_connected();
  auto next_tick = std::chrono::steady_clock::now();
  while (!interrupted.load()) {
    if (auto event = events_.pop(next_tick)) {
      if (auto* question = std::get_if<Asked>(&*event)) {
        (*question)(*farm_);
      } else if (auto handled = handle(std::get<EngineEvent>(*event)); !handled) {
        farm_->shut_down();
        return handled;
      }
    }
    if (std::chrono::steady_clock::now() >= next_tick) {
      farm_->tick();
      next_tick = std::chrono::steady_clock::now() + kTick;
    }
    publish_version();
  }
  farm_->shut_down();
  return {};
}

template <typename Question>
auto FarmProcess::ask(Question question) -> std::invoke_result_t<Question, Farm&> {
  using Given = std::invoke_result_t<Question, Farm&>;
  const auto when_closed = [] {
    if constexpr (std::is_constructible_v<Given, tl::unexpected<Error>>) {
      return Given(tl::unexpected(closing()));
    } else {
      return Given();
    }
  };
  // Held by the queue and by us: whoever lets go last, a question that is never asked breaks its promise.
  auto promise = std::make_shared<std::promise<Given>>();
  std::future<Given> answer = promise->get_future();
  const bool asked = events_.push(
      Event(Asked([promise, question = std::move(question)](Farm& farm) { promise->set_value(question(farm)); })));
  promise.reset();
  if (!asked) return when_closed();
  while (answer.wait_for(kTick) != std::future_status::ready) {
    if (events_.closed()) return when_closed();
  }
  try {
    return answer.get();
  } catch (const std::future_error&) {
    return when_closed();
  }
}

Result<JobView> FarmProcess::submit(const Submission& submission) {
  return ask([submission](Farm& farm) { return farm.submit(submission); });
}
Result<Validation> FarmProcess::validate(const Submission& submission) {
  return ask([submission](Farm& farm) { return farm.validate(submission); });
}
Result<JobList> FarmProcess::list(const JobFilter& filter) {
  return ask([filter](Farm& farm) { return farm.list(filter); });
}
Result<JobView> FarmProcess::show(const std::string& id) {
  return ask([id](Farm& farm) { return farm.show(id); });
}
Result<JobView> FarmProcess::act(const std::string& id, JobEvent verb, const std::string& by) {
  return ask([id, verb, by](Farm& farm) { return farm.act(id, verb, by); });
}
Result<JobView> FarmProcess::extend(const std::string& id, const StopChange& stops, const std::string& by) {
  return ask([id, stops, by](Farm& farm) { return farm.extend(id, stops, by); });
}
Result<JobView> FarmProcess::change(const std::string& id, const JobChange& change, const std::string& by) {
  return ask([id, change, by](Farm& farm) { return farm.change(id, change, by); });
}
Result<void> FarmProcess::remove(const std::string& id, const std::string& by) {
  return ask([id, by](Farm& farm) { return farm.remove(id, by); });
}
Result<UnitPage> FarmProcess::units(const std::string& id, std::optional<std::uint64_t> after) {
  return ask([id, after](Farm& farm) { return farm.units(id, after); });
}
Result<std::vector<ConvergencePoint>> FarmProcess::convergence(const std::string& id) {
  return ask([id](Farm& farm) { return farm.convergence(id); });
}
Result<Estimate> FarmProcess::estimate(const std::string& id, const EstimateRequest& request) {
  return ask([id, request](Farm& farm) { return farm.estimate(id, request); });
}
Result<std::filesystem::path> FarmProcess::artifact(const std::string& id, Artifact kind) {
  return ask([id, kind](Farm& farm) { return farm.artifact(id, kind); });
}
Result<std::string> FarmProcess::preview_png(const std::string& id) {
  return ask([id](Farm& farm) { return farm.preview_png(id); });
}
Result<LayerList> FarmProcess::layers(const std::string& id) {
  return ask([id](Farm& farm) { return farm.layers(id); });
}
Result<LayerPixels> FarmProcess::pixels(const std::string& id, const std::string& layer, int max_width) {
  return ask([=](Farm& farm) { return farm.pixels(id, layer, max_width); });
}
Result<std::vector<LogEntry>> FarmProcess::logs(const std::string& id, std::uint64_t after) {
  return ask([id, after](Farm& farm) { return farm.logs(id, after); });
}
std::vector<WorkerView> FarmProcess::workers() {
  return ask([](Farm& farm) { return farm.workers(); });
}
Result<WorkerView> FarmProcess::steer(const std::string& worker, WorkerVerb verb, const std::string& by) {
  return ask([worker, verb, by](Farm& farm) { return farm.steer(worker, verb, by); });
}

std::uint64_t FarmProcess::wait_for_change(std::uint64_t version, double seconds) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return closed_ || version_ != version; });
  return version_;
}

}  // namespace pf
