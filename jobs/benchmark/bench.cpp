#include "jobs/benchmark/bench.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/base/status_line.h"
#include "jobs/benchmark/machine.h"
#include "jobs/benchmark/worker_runner.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

/// Keeps other benches out of a folder while it lives.
class FolderLock {
 public:
  explicit FolderLock(const fs::path& folder)
      : fd_(open((folder / "lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644)) {
    held_ = fd_ >= 0 && flock(fd_, LOCK_EX | LOCK_NB) == 0;
  }
  ~FolderLock() {
    if (fd_ >= 0) close(fd_);
  }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;
  [[nodiscard]] bool held() const { return held_; }

 private:
  int fd_;
  bool held_ = false;
};

class Bench {
 public:
  Bench(const BenchRequest& request, Runner& runner, const std::function<void(const BenchProgress&)>& progress,
        BenchResult& result)
      : request_(request), runner_(runner), progress_(progress), result_(result) {}

  Result<void> run() {
    auto scenes = prepare_scenes(result_.suite, request_.out);
    if (!scenes) return tl::unexpected(scenes.error());
    auto schedule = make_schedule(result_.suite, *scenes, request_.worker, request_.out);
    if (!schedule) return tl::unexpected(schedule.error());
    schedule_ = std::move(*schedule);
    where_.total = schedule_.size();
    for (Scene& scene : *scenes) {
      SceneResult& to = result_.scenes.emplace_back();
      to.scene = std::move(scene);
      to.methods.resize(result_.suite.methods.size());
    }
    for (SceneResult& scene : result_.scenes) {
      if (auto done = find_reference(scene); !done) return done;
    }
    for (const Run& run : schedule_) {
      if (auto done = make(run); !done) return done;
      ++where_.done;
    }
    return {};
  }
  /// Runs point into it: it must outlive the result.
  [[nodiscard]] std::vector<Run> take_schedule() { return std::move(schedule_); }

 private:
  Result<void> find_reference(SceneResult& scene) {
    const fs::path cache = request_.cache.empty() ? request_.out / "references" : request_.cache;
    const auto show = [&](double seconds, std::uint64_t passes, double noise) {
      where_.doing = fmt::format("reference of {}: {} passes, {}", scene.scene.name, passes, clock_time(seconds));
      if (noise > 0) where_.doing += fmt::format(", noise {:.2g} so far", noise);
      where_.left = -1;
      progress_(where_);
    };
    auto reference =
        ensure_reference(scene.scene, cache, static_cast<int>(last_processors(1024).size()), runner_, show);
    if (!reference) return tl::unexpected(reference.error());
    scene.reference = std::move(*reference);
    return {};
  }

  Result<void> make(const Run& run) {
    SceneResult& scene = result_.scenes[run.scene];
    auto known = read_run(run);
    if (known && !known->error.empty() && request_.retry_failed) known.reset();
    if (!known && request_.report_only) return {};
    if (!known) {
      auto rendered = render(run, scene.scene);
      if (!rendered) return rendered;
      known = read_run(run);
    }
    if (!known)
      return fail(ErrorKind::kInternal, fmt::format("{}: the run just made cannot be read", run.order.out.string()));
    seconds_[{run.scene, run.method}] = known->wall_seconds;
    if (auto measured = measure(*known, scene.reference); !measured) return measured;
    scene.methods[run.method].runs.push_back(std::move(*known));
    return {};
  }

  Result<void> render(const Run& run, const Scene& scene) {
    std::error_code code;
    fs::remove_all(run.order.out, code);  // what an interrupted run left
    fs::create_directories(run.order.out, code);
    if (code)
      return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", run.order.out.string(), code.message()));
    const std::string doing =
        fmt::format("{}, {}, seed {}", scene.name, result_.suite.methods[run.method].name, run.seed);
    const auto show = [&](double seconds) {
      where_.doing = fmt::format("{}: {}", doing, clock_time(seconds));
      where_.left = std::max(0.0, seconds_left() - seconds);
      progress_(where_);
    };
    RenderOutcome outcome{{}, scene.error, 0};
    if (scene.error.empty()) {
      auto rendered = runner_.render(run.order, show);
      if (!rendered) return tl::unexpected(rendered.error());
      outcome = std::move(*rendered);
    }
    // The checkpoint and the whole image are of no more use; the snapshots are.
    for (const char* what : {".checkpoint", ".exr", ".png"})
      fs::remove(run.order.out / (kImageName + std::string(what)), code);
    return write_run(run, outcome, result_.suite, scene);
  }

  /// Of this run and all after it, from what runs like them took; the budget, where there was none yet.
  [[nodiscard]] double seconds_left() const {
    double known = 0;
    for (const auto& [of, seconds] : seconds_) known += seconds;
    const double typical = !seconds_.empty()            ? known / static_cast<double>(seconds_.size())
                           : result_.suite.by_seconds() ? 1.2 * result_.suite.seconds.back()
                                                        : 10.0;
    double left = 0;
    for (std::size_t i = where_.done; i < schedule_.size(); ++i) {
      const auto same = seconds_.find({schedule_[i].scene, schedule_[i].method});
      left += same == seconds_.end() ? typical : same->second;
    }
    return left;
  }

  const BenchRequest& request_;
  Runner& runner_;
  const std::function<void(const BenchProgress&)>& progress_;
  BenchResult& result_;
  std::vector<Run> schedule_;
  std::map<std::pair<std::size_t, std::size_t>, double> seconds_;  ///< that runs of this scene and method took
  BenchProgress where_;
};

}  // namespace

Result<BenchResult> run_bench(const BenchRequest& request, Runner& runner,
                              const std::function<void(const BenchProgress&)>& progress,
                              std::vector<std::string>& notes) {
  BenchResult result;
  auto suite = load_suite(request.suite, notes);
  if (!suite) return tl::unexpected(suite.error());
  result.suite = std::move(*suite);
  std::error_code code;
  fs::create_directories(request.out, code);
  const FolderLock lock(request.out);
  if (code || !lock.held()) {
    return fail(ErrorKind::kUsage,
                fmt::format("--out {}: cannot be written, or another bench is using it; expected a folder "
                            "of its own",
                            request.out.string()));
  }
  result.machine = describe_machine(request.worker);
  Bench bench(request, runner, progress, result);
  if (auto done = bench.run(); !done) return tl::unexpected(done.error());
  result.schedule = bench.take_schedule();
  analyse(result);
  return result;
}

}  // namespace pf::bench
