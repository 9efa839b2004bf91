#include "worker/render_executor.h"

#include <algorithm>
#include <exception>

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

namespace pf {
namespace {

/// Jobs that share a worker take turns; more scenes than this would cost memory for little.
constexpr std::size_t kScenes = 2;

}  // namespace

RenderExecutor::RenderExecutor(int threads, const Clock& clock, std::function<void(WorkDone)> done)
    : threads_(threads), clock_(clock), done_(std::move(done)), thread_([this] { serve(); }) {}

RenderExecutor::~RenderExecutor() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void RenderExecutor::start(Work work) {
  {
    const std::lock_guard lock(mutex_);
    work_ = std::move(work);
  }
  changed_.notify_all();
}

void RenderExecutor::serve() {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads_));
  tbb::task_arena arena(threads_);
  while (true) {
    std::optional<Work> work;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return closing_ || work_; });
      if (closing_) return;
      work = std::exchange(work_, std::nullopt);
    }
    WorkDone done;
    try {
      arena.execute([&] { done = run(*work); });
    } catch (const std::exception& error) {  // out of memory above all
      done.status = fail(ErrorKind::kInternal, error.what());
    }
    work.reset();
    done_(std::move(done));
  }
}

Result<std::shared_ptr<const LoadedJob>> RenderExecutor::loaded(const Work& work) {
  const auto known =
      std::find_if(scenes_.begin(), scenes_.end(), [&](const auto& s) { return s.first == work.bundle; });
  if (known != scenes_.end()) {
    std::rotate(scenes_.begin(), known, known + 1);
    return scenes_.front().second;
  }
  if (!work.spec.cache.file.empty()) {
    return fail(ErrorKind::kInvalidSpec,
                "cache.file: workers of a farm share no files, and the image would depend on each one's; expected no "
                "cache.file, or "
                "photonfarm render");
  }
  if (scenes_.size() >= kScenes) scenes_.pop_back();
  auto job = load_job_scene(work.spec, clock_);
  if (!job) return tl::unexpected(job.error());
  scenes_.emplace_front(work.bundle, std::make_shared<const LoadedJob>(std::move(*job)));
  return scenes_.front().second;
}

WorkDone RenderExecutor::run(const Work& work) {
  WorkDone done;
  const auto job = loaded(work);
  if (!job) {
    done.status = tl::unexpected(job.error());
    return done;
  }
  const Integrator& integrator = *(*job)->integrator;
  const double start = clock_.now();
  if (work.kind == Work::Kind::kPrepare) {
    done.prepared = std::make_unique<PreparedScene>();
    done.prepared->film = integrator.film_options();
    done.prepared->radii = integrator.initial_radii();
    done.prepared->scene_hash = (*job)->scene_hash;
    done.prepared->plan_line = plan_line((*job)->plan);
    done.prepared->warnings = (*job)->warnings();
  } else {
    const FilmOptions film = integrator.film_options();
    work.sums->make_room(PassOrder(film).part(work.first_sub_pass).sample, film.extra);
    integrator.run({work.first_sub_pass, work.sub_passes}, *work.state, *work.sums);
  }
  done.seconds = clock_.now() - start;
  return done;
}

}  // namespace pf
