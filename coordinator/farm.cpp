#include "coordinator/farm.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include <fmt/format.h>

#include "common/wire/bundle.h"
#include "common/wire/limits.h"

namespace pf {
namespace {

constexpr double kPublishRetrySeconds = 0.5;
/// Jobs that have a film in memory at a time, of one priority or a higher one: further ones of it wait for their turn.
constexpr std::size_t kMaxActiveJobs = 16;
constexpr std::uint64_t kEveryRun = std::numeric_limits<std::uint64_t>::max();

/// Ten points of priority double a job's share of the workers.
double weight_of(int priority) { return std::exp2((priority - 50) / 10.0); }

wire::ToWorker envelope() {
  wire::ToWorker message;
  message.set_version(kWireVersion);
  return message;
}

}  // namespace

Farm::Farm(FarmOptions options, CoordinatorPort& port, BlobStore& blobs, const Clock& clock,
           std::function<std::int64_t()> unix_ms, const Log& log)
    : options_(std::move(options)),
      port_(port),
      blobs_(blobs),
      clock_(clock),
      unix_ms_(std::move(unix_ms)),
      log_(log),
      metrics_(options_.metrics != nullptr ? *options_.metrics : uncounted_),
      registry_(options_.worker_silence_seconds) {}

JobSurroundings Farm::surroundings() {
  return {
      *store_,
      blobs_,
      clock_,
      unix_ms_,
      options_.build_id,
      options_.ack_wait_seconds,
      [this](const std::string& job, const BlobId& state) {
        return std::any_of(jobs_.begin(), jobs_.end(), [&](const auto& entry) {
          return entry.first != job && entry.second.job && entry.second.job->state() == state;
        });
      },
      [this](const std::string& job, std::string_view level, std::string_view source, std::string_view text) {
        ++version_;
        const auto it = jobs_.find(job);
        if (it != jobs_.end()) it->second.log.add(unix_ms_(), level, source, text);
        log_.info(
            "job",
            {{"id", job}, {"level", std::string(level)}, {"source", std::string(source)}, {"text", std::string(text)}});
      },
      metrics_};
}

Result<void> Farm::restore() {
  const auto folder = options_.state / "jobs";
  std::error_code code;
  std::filesystem::create_directories(folder, code);
  if (code) return fail(ErrorKind::kUsage, fmt::format("{}: cannot be made: {}", folder.string(), code.message()));
  auto store = JobStore::open(options_.state / JobStore::kFileName);
  if (!store) return tl::unexpected(store.error());
  store_.emplace(std::move(*store));
  if (auto imported = import_jobs(); !imported) return imported;
  auto loaded = store_->load();
  if (!loaded) return tl::unexpected(loaded.error());
  for (const auto& [id, why] : loaded->broken) log_.error("job cannot be restored", {{"id", id}, {"why", why}});
  for (JobRecord& record : loaded->records) {
    const std::string id = record.id;
    std::filesystem::create_directories(folder / id, code);
    Entry& entry = jobs_[id];
    entry.log = JobLog(folder / id);
    entry.job = FarmJob::restore(std::move(record), folder / id, surroundings());
    entry.runs_announced = entry.job->runs_over();
  }
  const auto workers = store_->workers();
  if (!workers) return tl::unexpected(workers.error());
  for (const JobStore::SteeredWorker& worker : *workers) registry_.remember(worker.name, worker.verb, worker.by);
  return {};
}

Result<void> Farm::import_jobs() {
  std::error_code code;
  for (const auto& entry : std::filesystem::directory_iterator(options_.state / "jobs", code)) {
    const auto file = entry.path() / "job.json";
    if (!std::filesystem::exists(file, code)) continue;
    auto record = import_job_json(entry.path());
    if (!record || record->id != entry.path().filename().string()) {
      log_.error("job cannot be imported",
                 {{"file", file.string()}, {"why", record ? "its record is of another job" : record.error().message}});
      continue;
    }
    std::vector<BlobId> blobs{record->bundle};
    if (auto manifest = blobs_.read(record->bundle, 0, kMaxBundleBytes)) {
      if (const auto bundle = parse_bundle(*manifest)) {
        for (const auto& content : bundle->files()) blobs.push_back(id_of(content.content()));
      }
    }
    const auto known = store_->has(record->id);
    if (!known) return tl::unexpected(known.error());
    // Known already: a coordinator that was killed between the two steps.
    const auto inserted = *known ? Result<void>() : store_->insert(*record, blobs);
    if (!inserted) {
      log_.error("job cannot be imported", {{"file", file.string()}, {"why", inserted.error().message}});
      continue;
    }
    std::filesystem::remove(file, code);
    log_.info("job imported", {{"id", record->id}});
  }
  return {};
}

FarmJob* Farm::find(const std::string& id) const {
  const auto it = jobs_.find(id);
  return it == jobs_.end() ? nullptr : it->second.job.get();
}

void Farm::send(const std::string& worker, const wire::ToWorker& message) { port_.send(worker, to_bytes(message)); }

void Farm::on_connected() {
  connected_ = true;
  pump();
}

void Farm::on_message(const std::string& sender, std::string_view bytes) {
  if (registry_.is_quarantined(sender)) {
    wire::ToWorker message = envelope();
    message.mutable_welcome()->set_accepted(false);
    message.mutable_welcome()->set_reason(registry_.all().at(sender).quarantined);
    return send(sender, message);
  }
  auto message = parse_from_worker(bytes);
  if (message && message->worker() != sender)
    message = fail(ErrorKind::kInvalidInput, "it calls itself " + message->worker());
  if (!message) {
    log_.warning("malformed message", {{"worker", sender}, {"why", message.error().message}});
    if (registry_.fault(sender, "malformed messages: " + message.error().message))
      accuse(sender, message.error().message);
    return;
  }
  const std::uint64_t incarnation = message->incarnation();
  switch (message->body_case()) {
    case wire::FromWorker::kHeartbeat:
      on_heartbeat(sender, incarnation, message->heartbeat());
      break;
    case wire::FromWorker::kBlobRequest:
      on_blob_request(sender, message->blob_request());
      break;
    case wire::FromWorker::kResult:
      if (FarmJob* job = find(message->result().job_id())) {
        give(sender, registry_.is_disabled(sender) ? job->refuse(sender, message->result(), "this worker is disabled")
                                                   : job->on_manifest(sender, incarnation, message->result()));
      } else {
        wire::ToWorker unknown = envelope();
        unknown.mutable_job_ended()->set_job_id(message->result().job_id());
        unknown.mutable_job_ended()->set_run(kEveryRun);
        send(sender, unknown);
      }
      break;
    case wire::FromWorker::kChunk:
      if (FarmJob* job = find(message->chunk().job_id()))
        give(sender, job->on_chunk(sender, incarnation, message->chunk()));
      break;
    case wire::FromWorker::kFailed:
      if (FarmJob* job = find(message->failed().job_id())) job->on_failed(sender, message->failed());
      break;
    case wire::FromWorker::kLog:
      if (find(message->log().job_id()) != nullptr) {
        jobs_.at(message->log().job_id()).log.add(unix_ms_(), "info", sender, message->log().text());
      }
      break;
    default:
      break;
  }
  ++version_;
  note_ended();
  pump();
}

void Farm::on_heartbeat(const std::string& worker, std::uint64_t incarnation, const wire::Heartbeat& heartbeat) {
  if (heartbeat.build_id() != options_.build_id) {
    wire::ToWorker message = envelope();
    message.mutable_welcome()->set_reason(
        fmt::format("its build is {}, the coordinator's is {}: an image's bits depend on the build",
                    heartbeat.build_id(), options_.build_id));
    log_.warning("worker of another build refused", {{"worker", worker}, {"build", heartbeat.build_id()}});
    return send(worker, message);
  }
  const auto known = registry_.all().find(worker);
  if (known == registry_.all().end() || known->second.incarnation != incarnation) {
    log_.info("worker joined", {{"worker", worker}, {"host", heartbeat.host()}});
    for (auto& [id, entry] : jobs_) entry.job->forget_worker(worker);
  }
  registry_.heard(worker, incarnation, heartbeat, clock_.now());
  for (auto& [id, entry] : jobs_) {
    if (entry.job->ended()) continue;
    std::vector<UnitRange> held;
    bool preparing = false;
    if (heartbeat.job_id() == id) {
      for (const wire::Unit& unit : heartbeat.held()) {
        if (unit.sub_passes() == 0) preparing = true;
        held.push_back({unit.first_sub_pass(), unit.sub_passes()});
      }
    }
    entry.job->on_held(worker, held, preparing);
    if (!held.empty()) entry.job->note_memory(heartbeat.resident_bytes());
  }
  welcome(worker);
}

void Farm::welcome(const std::string& worker) {
  wire::ToWorker message = envelope();
  message.mutable_welcome()->set_ack_wait_seconds(options_.ack_wait_seconds);
  message.mutable_welcome()->set_accepted(true);
  message.mutable_welcome()->set_idle(registry_.is_idled(worker));
  send(worker, message);
}

void Farm::on_blob_request(const std::string& worker, const wire::BlobRequest& request) {
  wire::ToWorker message = envelope();
  wire::BlobPart& part = *message.mutable_blob_part();
  *part.mutable_blob() = request.blob();
  part.set_offset(request.offset());
  if (const BlobId id = id_of(request.blob()); blobs_.has(id)) {
    if (auto bytes = blobs_.read(id, request.offset(), kMaxChunkBytes)) {
      part.set_data(std::move(*bytes));
    } else {
      log_.error("blob cannot be read", {{"sha256", id.sha256}, {"why", bytes.error().message}});
      return;  // the worker asks again
    }
  }
  send(worker, message);
}

void Farm::give(const std::string& worker, Answer answer) {
  if (answer.reply) {
    wire::ToWorker message = envelope();
    *message.mutable_result_reply() = std::move(*answer.reply);
    send(worker, message);
  }
  if (!answer.accusation.empty()) accuse(worker, answer.accusation);
}

void Farm::accuse(const std::string& worker, const std::string& what) {
  registry_.quarantine(worker, what);
  ++metrics_.quarantines;
  log_.error("worker quarantined", {{"worker", worker}, {"why", what}});
  for (auto& [id, entry] : jobs_) {
    if (entry.job->ended()) continue;
    entry.job->forget_worker(worker);
    entry.log.add(unix_ms_(), "error", "coordinator", fmt::format("{} is in quarantine: {}", worker, what));
  }
}

void Farm::note_ended() {
  for (auto& [id, entry] : jobs_) {
    const std::uint64_t over = entry.job->runs_over();
    if (over <= entry.runs_announced) continue;
    entry.runs_announced = over;
    wire::ToWorker message = envelope();
    message.mutable_job_ended()->set_job_id(id);
    message.mutable_job_ended()->set_run(over - 1);
    send("", message);
  }
}

const FarmJob* Farm::next_to_begin() const {
  // By priority; first come, first served among those of one.
  const auto key = [](const FarmJob& j) { return std::tuple(-j.record().spec.job.priority, j.record().number); };
  const FarmJob* first = nullptr;
  for (const auto& [id, entry] : jobs_) {
    const FarmJob& job = *entry.job;
    if (job.record().state == JobState::kQueued && (first == nullptr || key(job) < key(*first))) first = &job;
  }
  if (first == nullptr) return nullptr;
  const int priority = first->record().spec.job.priority;
  const auto active = std::count_if(jobs_.begin(), jobs_.end(), [&](const auto& entry) {
    return entry.second.job->active() && entry.second.job->record().spec.job.priority >= priority;
  });
  return static_cast<std::size_t>(active) < kMaxActiveJobs ? first : nullptr;
}

FarmJob* Farm::next_job(std::size_t window, const std::vector<FarmJob*>& without_work) {
  std::size_t queued = 0;
  for (const auto& [id, entry] : jobs_) queued += entry.job->queued();
  const FarmJob* beginner = next_to_begin();
  // Fair among those that have work now: a job that waits at its barrier does not save up turns.
  const Entry* chosen = nullptr;
  for (const auto& [id, entry] : jobs_) {
    FarmJob* job = entry.job.get();
    if (job->ended() || std::find(without_work.begin(), without_work.end(), job) != without_work.end()) continue;
    if (queued >= window && !job->must_repeat()) continue;
    if (job->record().state == JobState::kQueued && job != beginner) continue;
    if (chosen == nullptr || entry.share < chosen->share) chosen = &entry;
  }
  return chosen == nullptr ? nullptr : chosen->job.get();
}

void Farm::pump() {
  if (!connected_ || clock_.now() < next_publish_) return;
  if (!purged_) {
    if (auto purged = port_.purge_tasks(); !purged) {
      next_publish_ = clock_.now() + kPublishRetrySeconds;
      return;
    }
    purged_ = true;
  }
  const std::size_t workers = registry_.live(clock_.now());
  const std::size_t window = options_.tasks_per_worker * std::max<std::size_t>(workers, 1);
  std::vector<FarmJob*> without_work;
  while (FarmJob* job = next_job(window, without_work)) {
    double& share = jobs_.at(job->id()).share;
    if (job->record().state == JobState::kQueued) share = std::max(share, least_share());
    const auto task = job->next_task(workers);
    if (!task) {
      without_work.push_back(job);
      continue;
    }
    share += job->cost(*task) / weight_of(job->record().spec.job.priority);
    if (!publish(*job, *task)) return;
  }
}

bool Farm::publish(FarmJob& job, const wire::Task& task) {
  const std::string id = fmt::format("{}.{}.{}.{}.{}.{:x}", task.job_id(), static_cast<int>(task.kind()), task.run(),
                                     task.unit().first_sub_pass(), task.unit().attempt(), options_.incarnation);
  if (port_.publish_task(id, to_bytes(task))) return true;
  job.not_published(task);
  next_publish_ = clock_.now() + kPublishRetrySeconds;
  return false;
}

void Farm::tick() {
  const double now = clock_.now();
  for (const std::string& worker : registry_.newly_lost(now)) {
    log_.warning("worker lost", {{"worker", worker}});
    // The engine hands its tasks to others; if it has lost them, the jobs publish them again.
    for (auto& [id, entry] : jobs_) entry.job->forget_worker(worker);
    ++version_;
  }
  for (auto& [id, entry] : jobs_) {
    const JobState before = entry.job->record().state;
    entry.job->tick([&](double since) { return registry_.any_idle_since(since, now); });
    if (entry.job->record().state != before) ++version_;
  }
  look_at_retention();
  note_ended();
  pump();
  std::uint64_t queued = 0;
  for (const auto& [id, entry] : jobs_) queued += entry.job->queued();
  metrics_.queued_units = queued;
}

void Farm::shut_down() {
  for (auto& [id, entry] : jobs_) entry.job->shut_down();
}

}  // namespace pf
