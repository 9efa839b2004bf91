#include "tests/simulation/world.h"

#include <sys/resource.h>

#include <cmath>
#include <csignal>
#include <limits>
#include <tuple>

#include <fmt/format.h>
#include <spdlog/sinks/null_sink.h>

#include "common/wire/limits.h"

namespace pf::test {
namespace {

constexpr double kAckWait = 4.0;
constexpr double kTick = 0.1;
constexpr double kTrust = 120.0;  ///< the engine drops a repeated id for so long
const std::string kBuild = "simulated";

}  // namespace

/// A worker process; its doors to the world close with it.
struct World::Process {
  std::string name;
  Lie lie = Lie::kNone;
  std::uint64_t incarnation = 0;
  double stopped_until = 0;
  double fetch_until = -1;  ///< an unanswered fetch
  std::unique_ptr<WorkerDoor> door;
  std::unique_ptr<FakeExecutor> executor;
  std::unique_ptr<BlobStore> blobs;
  std::unique_ptr<Session> session;
};

struct World::CoordinatorDoor final : CoordinatorPort {
  explicit CoordinatorDoor(World& w) : world(w) {}
  Result<void> publish_task(std::string_view id, std::string_view bytes) override {
    if (!world.engine_up_) return fail(ErrorKind::kUnavailable, "the engine is down");
    auto& last = world.task_ids_.try_emplace(std::string(id), -kTrust).first->second;
    if (world.clock_.now() - last < kTrust) return {};
    last = world.clock_.now();
    world.tasks_[world.next_task_++] = Task{std::string(bytes), {}, 0, 0};
    world.at(world.clock_.now() + 0.001, [this] { world.hand_out(); });
    return {};
  }
  Result<void> purge_tasks() override {
    if (!world.engine_up_) return fail(ErrorKind::kUnavailable, "the engine is down");
    std::erase_if(world.tasks_, [](const auto& entry) { return entry.second.holder.empty(); });
    return {};
  }
  void send(std::string_view worker, std::string_view bytes) override {
    for (const auto& [name, process] : world.workers_) {
      if (worker.empty() || worker == name) world.to_worker(name, std::string(bytes));
    }
  }
  World& world;
};

struct World::WorkerDoor final : WorkerPort {
  WorkerDoor(World& w, Process& p) : world(w), process(p), incarnation(p.incarnation) {}
  void fetch_task(double seconds) override {
    process.fetch_until = world.clock_.now() + std::max(seconds, 0.01);
    const double until = process.fetch_until;
    world.at(world.clock_.now() + 0.001, [this] { world.hand_out(); });
    world.at(until, [until, &w = world, name = process.name, mine = incarnation] {
      const auto it = w.workers_.find(name);
      if (it == w.workers_.end() || it->second->incarnation != mine || it->second->fetch_until != until) return;
      it->second->fetch_until = -1;
      it->second->session->on_no_task();
    });
  }
  void acknowledge(std::uint64_t handle) override {
    if (world.engine_up_) world.tasks_.erase(handle);  // a late ack of an old owner works too, as in the real engine
  }
  void in_progress(std::uint64_t handle) override {
    const auto it = world.tasks_.find(handle);
    if (world.engine_up_ && it != world.tasks_.end() && it->second.holder_incarnation == incarnation) {
      it->second.deadline = world.clock_.now() + kAckWait;
    }
  }
  void give_back(std::uint64_t handle) override {
    const auto it = world.tasks_.find(handle);
    if (!world.engine_up_ || it == world.tasks_.end()) return;
    it->second.holder.clear();
    world.at(world.clock_.now() + 0.001, [this] { world.hand_out(); });
  }
  void send(std::string_view bytes) override { world.to_coordinator(process.name, std::string(bytes)); }
  World& world;
  Process& process;
  std::uint64_t incarnation;
};

struct World::FakeExecutor final : Executor {
  FakeExecutor(World& w, Process& p) : world(w), process(p) {}
  void start(Work work) override {
    auto done = std::make_shared<WorkDone>();
    done->seconds = 0.05 + world.random();
    if (work.kind == Work::Kind::kPrepare) {
      done->prepared = std::make_unique<PreparedScene>();
      done->prepared->film = pretended_film(work.spec);
      done->prepared->radii = pretended_radii(work.spec);
      done->prepared->scene_hash = "scene";
      done->prepared->plan_line = "pretended";
    } else {
      pretend_to_trace(work.spec, work.first_sub_pass, work.sub_passes, *work.state, *work.sums);
      world.traced_ += work.sub_passes;
      if (process.lie == Lie::kOtherSums) work.sums->pixels[0].direct[0] += 1;
      if (process.lie == Lie::kNanFigures) done->seconds = std::numeric_limits<double>::quiet_NaN();
    }
    const double duration = std::isfinite(done->seconds) ? done->seconds : 0.1;
    world.at_worker(world.clock_.now() + duration, process.name, process.incarnation,
                    [done](Process& p) { p.session->on_done(std::move(*done)); });
  }
  World& world;
  Process& process;
};

World::World(std::uint64_t seed, Mischief mischief)
    : rng_(seed), mischief_(mischief), log_(LogLevel::kError, std::make_shared<spdlog::sinks::null_sink_mt>()) {
  clock_.advance(1000.0);
  start_coordinator();
}

World::~World() { fill_disk(false); }

// The whole process's, as if all lived on one disk; what exists stays readable.
void World::fill_disk(bool full) {
  constexpr ::rlim_t kFullBytes = 64;
  ::rlimit limit = {};
  ::getrlimit(RLIMIT_FSIZE, &limit);
  limit.rlim_cur = full ? kFullBytes : limit.rlim_max;
  if (full) std::signal(SIGXFSZ, SIG_IGN);
  ::setrlimit(RLIMIT_FSIZE, &limit);
  disk_full_ = full;
}

double World::random() { return std::uniform_real_distribution<double>(0.0, 1.0)(rng_); }

void World::at(double time, std::function<void()> action) { events_.push({time, order_++, std::move(action)}); }

void World::at_worker(double time, const std::string& name, std::uint64_t incarnation,
                      std::function<void(Process& process)> action) {
  at(time, [this, name, incarnation, action = std::move(action)] {
    Process& p = *workers_.at(name);
    if (p.incarnation != incarnation) return;
    if (p.stopped_until > clock_.now()) return at_worker(p.stopped_until, name, incarnation, action);
    action(p);
  });
}

void World::start_coordinator() {
  auto store = BlobStore::open(folder_ / "blobs", 0);
  blobs_ = std::make_unique<BlobStore>(std::move(*store));
  coordinator_door_ = std::make_unique<CoordinatorDoor>(*this);
  FarmOptions options;
  options.state = folder_.path();
  options.build_id = kBuild;
  options.ack_wait_seconds = kAckWait;
  options.incarnation = ++incarnation_;
  options.retention = retention_;
  options.jobs_per_token = jobs_per_token_;
  farm_ = std::make_unique<Farm>(
      options, *coordinator_door_, *blobs_, clock_, [this] { return static_cast<std::int64_t>(clock_.now() * 1000); },
      log_);
  if (!farm_->restore()) {
    // Ends, and the supervisor tries again.
    farm_.reset();
    return at(clock_.now() + 1.0, [this] { start_coordinator(); });
  }
  farm_->on_connected();
}

void World::add_worker(const std::string& name, Lie lie) {
  auto process = std::make_unique<Process>();
  process->name = name;
  process->lie = lie;
  workers_[name] = std::move(process);
  start_worker(name);
}

void World::start_worker(const std::string& name) {
  Process& p = *workers_.at(name);
  p.incarnation = ++incarnation_;
  p.fetch_until = -1;
  p.stopped_until = 0;
  auto store = BlobStore::open(folder_ / "cache" / name, 0);
  p.session.reset();
  p.blobs = std::make_unique<BlobStore>(std::move(*store));
  p.door = std::make_unique<WorkerDoor>(*this, p);
  p.executor = std::make_unique<FakeExecutor>(*this, p);
  SessionOptions options;
  options.name = name;
  options.host = "here";
  options.incarnation = p.incarnation;
  options.build_id = p.lie == Lie::kOtherBuild ? "another" : kBuild;
  options.cache = folder_ / "cache";
  p.session = std::make_unique<Session>(options, *p.door, *p.executor, *p.blobs, clock_, log_);
  p.session->start();
}

void World::kill_worker(const std::string& name) {
  const double back = clock_.now() + 2.0 * random();
  Process& p = *workers_.at(name);
  p.incarnation = ++incarnation_;  // what is under way to the old one finds nobody
  p.stopped_until = std::numeric_limits<double>::infinity();
  p.fetch_until = -1;
  at(back, [this, name] { start_worker(name); });
}

void World::lose_worker(const std::string& name) {
  Process& p = *workers_.at(name);
  p.incarnation = ++incarnation_;
  p.stopped_until = std::numeric_limits<double>::infinity();
  p.fetch_until = -1;
}

void World::kill_coordinator() {
  if (!farm_) return;
  farm_.reset();
  at(clock_.now() + 3.0 * random(), [this] { start_coordinator(); });
}

void World::hand_out() {
  if (!engine_up_) return;
  for (auto& [name, p] : workers_) {
    if (p->fetch_until < clock_.now() || p->stopped_until > clock_.now()) continue;
    for (auto& [handle, task] : tasks_) {
      if (!task.holder.empty()) continue;
      task.holder = name;
      task.holder_incarnation = p->incarnation;
      task.deadline = clock_.now() + kAckWait;
      p->fetch_until = -1;
      at(clock_.now() + 0.001, [this, to_name = name, mine = p->incarnation, delivery = Delivery{handle, task.bytes}] {
        Process& to = *workers_.at(to_name);
        if (to.incarnation == mine) to.session->on_task(delivery);
      });
      break;
    }
  }
}

void World::deliver(const std::function<void()>& arrive) {
  if (!engine_up_ || chance(mischief_.drop)) return;
  const double now = clock_.now();
  const auto lag = [&] { return chance(mischief_.delay) ? 6.0 * random() : 0.002 + 0.02 * random(); };
  at(now + lag(), arrive);
  if (chance(mischief_.repeat)) at(now + lag(), arrive);
}

void World::to_coordinator(const std::string& sender, std::string bytes) {
  wire::FromWorker message;
  const bool parsed = message.ParseFromString(bytes);
  if (parsed && message.has_chunk() && !message.chunk().data().empty() && chance(mischief_.corrupt_chunk)) {
    (*message.mutable_chunk()->mutable_data())[0] ^= 0x40;
    bytes = to_bytes(message);
  }
  if (parsed && message.has_result() && workers_.at(sender)->lie == Lie::kWrongHash) {
    (*message.mutable_result()->mutable_content())[0] ^= 1;
    bytes = to_bytes(message);
  }
  deliver([this, sender, bytes] {
    if (farm_) farm_->on_message(sender, bytes);
  });
}

void World::to_worker(const std::string& name, std::string bytes) {
  const std::uint64_t incarnation = workers_.at(name)->incarnation;
  deliver([this, name, incarnation, bytes] {
    at_worker(clock_.now(), name, incarnation, [bytes](Process& p) { p.session->on_message(bytes); });
  });
}

void World::misbehave() {
  for (auto& [name, p] : workers_) {
    if (p->stopped_until > clock_.now()) continue;
    if (chance(mischief_.kill_worker * kTick))
      kill_worker(name);
    else if (chance(mischief_.stop_worker * kTick))
      p->stopped_until = clock_.now() + 12.0 * random();
  }
  if (chance(mischief_.kill_coordinator * kTick)) kill_coordinator();
  if (!disk_full_ && chance(mischief_.fill_disk * kTick)) {
    fill_disk(true);
    at(clock_.now() + 15.0 * random(), [this] { fill_disk(false); });
  }
  if (engine_up_ && chance(mischief_.kill_engine * kTick)) {
    engine_up_ = false;
    if (chance(mischief_.lose_queue)) lose_queue();
    at(clock_.now() + 5.0 * random(), [this] {
      engine_up_ = true;
      if (farm_) farm_->on_connected();
      hand_out();
    });
  }
}

void World::step() {
  const double end = clock_.now() + kTick;
  misbehave();
  while (!events_.empty() && events_.top().time <= end) {
    const Event event = events_.top();
    events_.pop();
    if (event.time > clock_.now()) clock_.advance(event.time - clock_.now());
    event.action();
  }
  clock_.advance(end - clock_.now());
  for (auto& [handle, task] : tasks_) {
    if (engine_up_ && !task.holder.empty() && task.deadline < end) task.holder.clear();
  }
  hand_out();
  if (farm_) farm_->tick();
  for (auto& [name, p] : workers_) {
    if (p->stopped_until <= end && !p->session->finished()) p->session->tick();
  }
}

void World::run_for(double seconds) {
  for (const double end = clock_.now() + seconds; clock_.now() < end;) step();
}

bool World::run(double seconds) {
  const double end = clock_.now() + seconds;
  while (clock_.now() < end) {
    step();
    if (!farm_) continue;
    bool all = true;
    for (const JobView& view : farm_->list()) all = all && has_ended(view.state);
    if (all) return true;
  }
  return false;
}

std::string World::describe() {
  std::string text = fmt::format("at {:.1f} s, engine {}, coordinator {}\n", clock_.now(), engine_up_ ? "up" : "down",
                                 farm_ ? "up" : "down");
  for (const auto& [name, p] : workers_) {
    text += fmt::format("worker {}: {}, fetch until {:.1f}, stopped until {:.1f}\n", name,
                        p->session->finished() ? "finished" : "going", p->fetch_until, p->stopped_until);
  }
  for (const auto& [handle, task] : tasks_) {
    const auto parsed = parse_task(task.bytes);
    text += fmt::format("task {}: {} {} attempt {}, with '{}' until {:.1f}\n", handle, parsed->job_id(),
                        parsed->unit().first_sub_pass(), parsed->unit().attempt(), task.holder, task.deadline);
  }
  if (!farm_) return text;
  for (const WorkerView& w : farm_->workers()) {
    text += fmt::format("farm sees {}: {} holding {} of {}, heard {:.1f} s ago\n", w.name, w.state, w.units_held,
                        w.job_id, w.seconds_since_heard);
  }
  for (const JobView& v : farm_->list()) {
    text += fmt::format("job {}: {} {}, {} passes, {} repeated\n", v.id, to_string(v.state), v.message, v.passes_done,
                        v.units_repeated);
    const auto log = farm_->logs(v.id, 0);
    for (std::size_t i = log->size() > 12 ? log->size() - 12 : 0; i < log->size(); ++i) {
      text += fmt::format("  {} {} {}\n", (*log)[i].unix_ms / 1000, (*log)[i].source, (*log)[i].text);
    }
  }
  return text;
}

Submission World::submission(const JobSpec& spec) {
  Submission submission;
  submission.spec_json = canonical_json(spec);
  const auto scene = blobs_->put("a scene");
  submission.files = {{spec.scene.file, *scene}};
  return submission;
}

std::string World::submit(const JobSpec& spec) {
  const auto view = farm_->submit(submission(spec));
  return view ? view->id : view.error().message;
}

JobSpec job_of(const std::string& name, IntegratorType type, ProgressiveMode mode, int passes) {
  JobSpec spec;
  spec.job.name = name;
  spec.scene.file = "scene.glb";
  spec.image.width = 5;
  spec.image.height = 3;
  spec.integrator.type = type;
  spec.integrator.mode = mode;
  spec.integrator.photons = 1000;
  spec.integrator.seed = 7;
  spec.stop.passes = passes;
  spec.checkpoint.seconds = 3;
  return spec;
}

}  // namespace pf::test
