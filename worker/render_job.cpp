#include "worker/render_job.h"

#include <algorithm>
#include <thread>

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "build_id.h"
#include "common/base/atomic_file.h"
#include "common/base/memory.h"
#include "common/wire/bundle.h"
#include "worker/integrators/factory.h"
#include "worker/scene/gltf_loader.h"
#include "worker/scene/scene_hash.h"

namespace pf {
namespace {

Result<const Camera*> choose_camera(const Scene& scene, const std::string& name) {
  const std::vector<Camera>& cameras = scene.cameras();
  if (name.empty()) return &cameras.front();
  const auto it = std::find_if(cameras.begin(), cameras.end(), [&](const Camera& c) { return c.name == name; });
  if (it != cameras.end()) return &*it;
  std::string names;
  for (const Camera& c : cameras) names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", c.name);
  return fail(ErrorKind::kInvalidInput,
              fmt::format("scene.camera: no camera is called \"{}\"; expected one of {}", name, names));
}

/// Names what a checkpoint belongs to.
std::string identity_of(const LoadedJob& job) {
  return fmt::format("spec {} scene {} build {} extra sums {}", image_hash_of_spec(job.spec), job.scene_hash, kBuildId,
                     static_cast<int>(job.integrator->film_options().extra));
}

/// The loop over rounds of one job.
class Rendering {
 public:
  Rendering(const RenderRequest& request, const LoadedJob& job, const Clock& clock,
            const std::function<void(const Progress&)>& progress)
      : request_(request),
        job_(job),
        clock_(clock),
        progress_(progress),
        paths_(request.out, job.spec.job.name),
        film_(job.integrator->film_options()),
        snapshots_(request.snapshots, request.out, job.spec.job.name, clock),
        start_(clock.now() - job.load_seconds),
        last_checkpoint_(clock.now()) {}

  Result<RenderResult> run() {
    const double opened_from = clock_.now();
    if (auto opened = open(); !opened) return tl::unexpected(opened.error());
    render_start_ = clock_.now();
    prepare_seconds_ = render_start_ - opened_from;
    const std::uint64_t first = film_.sub_passes();
    while (!stops(film_.sub_passes() - first)) {
      job_.integrator->run({film_.sub_passes(), 1}, film_.state(), film_.sums());
      film_.close_round_if_complete();
      if (film_.sums().faults.overflow > 0) {
        return fail(ErrorKind::kInternal, overflow_message(job_.spec.job.name, film_.sums().faults.overflow));
      }
      report();
      if (auto taken = take_snapshot(first, false); !taken) return tl::unexpected(taken.error());
      if (request_.interrupted != nullptr && request_.interrupted->load()) return interrupted();
      if (auto saved = save_if_due(); !saved) return tl::unexpected(saved.error());
    }
    if (auto taken = take_snapshot(first, true); !taken) return tl::unexpected(taken.error());
    return write();
  }

 private:
  Result<void> open() {
    std::error_code code;
    std::filesystem::create_directories(request_.out, code);
    if (code) {
      return fail(ErrorKind::kUsage,
                  fmt::format("--out {}: cannot be made: {}", request_.out.string(), code.message()));
    }
    if (request_.resume) {
      auto loaded = Film::load(paths_.checkpoint, identity_of(job_));
      if (!loaded) {
        return fail(loaded.error().kind, loaded.error().message + "; start without --resume to render anew");
      }
      film_ = std::move(*loaded);
      return {};
    }
    auto radii = job_.integrator->initial_radii();
    if (!radii.empty()) film_.set_initial_radii(std::move(radii));
    return {};
  }

  [[nodiscard]] bool stops(std::uint64_t done_here) {
    const JobSpec::Stop& stop = job_.spec.stop;
    const std::uint64_t done = film_.sub_passes();
    if (stop.passes > 0 && done >= film_.order().sub_passes(static_cast<std::uint64_t>(stop.passes))) return true;
    if (stop.error > 0 && done >= 2 && done == film_.round_begin() && film_.estimated_error() <= stop.error)
      return true;
    if (stop.memory > 0 && done > 0 && peak_resident_bytes() > static_cast<std::uint64_t>(stop.memory) << 20)
      return true;
    if (stop.seconds <= 0 || done == 0) return false;
    if (snapshots_.wanted() && !Snapshots::whole(film_)) return false;  // it could not be judged
    return seconds_after_next(done_here) > stop.seconds;
  }
  /// When one more sub-pass would be done and the image written.
  [[nodiscard]] double seconds_after_next(std::uint64_t done_here) const {
    const double now = clock_.now();
    const double sub_pass = done_here > 0 ? (now - render_start_) / static_cast<double>(done_here) : 0.0;
    return now - start_ + sub_pass + write_reserve();
  }
  Result<void> take_snapshot(std::uint64_t first, bool last) {
    if (!snapshots_.wanted()) return {};
    auto spent = snapshots_.take(film_, clock_.now() - start_, seconds_after_next(film_.sub_passes() - first), last);
    if (!spent) return tl::unexpected(spent.error());
    start_ += *spent;
    render_start_ += *spent;
    return {};
  }
  /// Seconds kept back for writing the image: about 40 ns a pixel for EXR, PNG and the last update.
  [[nodiscard]] double write_reserve() const { return 4e-7 * static_cast<double>(film_.sums().pixels.size()); }

  void report() {
    Progress p;
    p.passes_done = static_cast<std::int64_t>(film_.order().mean_passes(film_.sub_passes()));
    p.passes_total = job_.spec.stop.passes;
    p.seconds_limit = job_.spec.stop.seconds;
    p.error_target = job_.spec.stop.error;
    // The estimate costs a sweep over the image; the progress line wants it only when the job does.
    if (p.error_target > 0 && film_.sub_passes() == film_.round_begin()) p.error = film_.estimated_error();
    p.rays = film_.sums().rays;
    p.photons = film_.sums().photon_paths;
    progress_(p);
  }

  Result<void> save() { return film_.save(paths_.checkpoint, identity_of(job_)); }
  Result<void> save_if_due() {
    if (clock_.now() - last_checkpoint_ < job_.spec.checkpoint.seconds) return {};
    last_checkpoint_ = clock_.now();
    return save();
  }
  Result<RenderResult> interrupted() {
    if (auto saved = save(); !saved) return tl::unexpected(saved.error());
    return fail(
        ErrorKind::kInterrupted,
        fmt::format("{}: interrupted after {} passes; {} is left: the same command with --resume goes on",
                    job_.spec.job.name, film_.order().mean_passes(film_.sub_passes()), paths_.checkpoint.string()));
  }

  Result<RenderResult> write() {
    const double written_from = clock_.now();
    RenderResult result;
    result.render_seconds = written_from - render_start_;
    result.load_seconds = job_.load_seconds;
    result.prepare_seconds = prepare_seconds_;
    result.warnings = job_.warnings();
    result.snapshots = snapshots_.taken();
    const ResultLabels labels{.name = job_.spec.job.name,
                              .exposure = static_cast<float>(job_.spec.image.exposure),
                              .spec_hash = image_hash_of_spec(job_.spec),
                              .scene_hash = job_.scene_hash,
                              .plan = plan_line(job_.plan),
                              .spec_json = canonical_json(job_.spec),
                              .files = file_list_json(hashed_files_of_job(job_.spec).value_or(FileList())),
                              .seed = job_.spec.integrator.seed};
    if (auto done = write_images(film_, labels, request_.out, result); !done) return tl::unexpected(done.error());
    result.write_seconds = clock_.now() - written_from;
    result.peak_bytes = peak_resident_bytes();
    if (auto done = write_file_atomically(paths_.json, result_json(job_.spec.job.name, result)); !done) {
      return tl::unexpected(done.error());
    }
    // A finished job keeps its checkpoint: more passes can be added with --resume.
    if (auto saved = save(); !saved) return tl::unexpected(saved.error());
    return result;
  }

  const RenderRequest& request_;
  const LoadedJob& job_;
  const Clock& clock_;
  const std::function<void(const Progress&)>& progress_;
  OutputPaths paths_;
  Film film_;
  Snapshots snapshots_;
  double start_;
  double render_start_ = 0;
  double prepare_seconds_ = 0;  ///< first radii, or reading a checkpoint
  double last_checkpoint_;
};

}  // namespace

Result<SceneDescription> load_scene_of_job(const JobSpec& spec) {
  GltfRequest request;
  request.file = spec.folder / spec.scene.file;
  request.root = spec.folder;
  request.scene = spec.scene.scene;
  request.camera = spec.scene.camera;
  auto description = load_gltf(request);
  if (!description) return description;
  Environment& environment = description->environment;
  const double scale = spec.scene.environment_scale;
  if (!spec.scene.environment.empty()) {
    environment.file = (spec.folder / spec.scene.environment).string();
    const auto factor = static_cast<float>(scale);
    environment.radiance = {factor, factor, factor};
  } else if (spec.scene.environment_radiance.size() == 3) {
    for (int c = 0; c < 3; ++c) {
      const double radiance = spec.scene.environment_radiance[static_cast<std::size_t>(c)];
      environment.radiance[c] = static_cast<float>(scale * radiance);
    }
  }
  for (Camera& camera : description->cameras) {
    camera.lens_radius = static_cast<float>(spec.scene.lens_radius);
    camera.focus_distance = static_cast<float>(spec.scene.focus_distance);
  }
  return description;
}

std::vector<std::string> LoadedJob::warnings() const {
  std::vector<std::string> all = scene->warnings();
  all.insert(all.end(), plan.warnings.begin(), plan.warnings.end());
  const std::vector<std::string> of_method = integrator->warnings();
  all.insert(all.end(), of_method.begin(), of_method.end());
  return all;
}

Result<LoadedJob> plan_job(const JobSpec& spec, const Clock& clock) {
  const double start = clock.now();
  LoadedJob job;
  job.spec = spec;
  auto description = load_scene_of_job(spec);
  if (!description) return tl::unexpected(description.error());
  job.facts = gather_facts(*description);
  auto hash = hash_scene(spec.folder / spec.scene.file, *description);
  if (!hash) return tl::unexpected(hash.error());
  job.scene_hash = std::move(*hash);
  if (!spec.cache.file.empty()) {
    auto told_apart = scene_parts(*description);
    if (!told_apart) return tl::unexpected(told_apart.error());
    job.parts = std::move(*told_apart);
  }
  auto scene = Scene::build(std::move(*description));
  if (!scene) return tl::unexpected(scene.error());
  job.scene = std::move(*scene);
  auto camera = choose_camera(*job.scene, spec.scene.camera);
  if (!camera) return tl::unexpected(camera.error());
  job.camera = *camera;
  const double piloted_from = clock.now();
  job.pilot = fly_pilot(*job.scene, *job.camera, spec);
  job.pilot_seconds = clock.now() - piloted_from;
  job.pilot.emission = fly_emission_pilot(*job.scene, *job.camera, spec, job.pilot);
  job.plan = make_plan(spec, job.facts, job.pilot);
  job.load_seconds = clock.now() - start;
  return job;
}

Result<LoadedJob> load_job_scene(const JobSpec& spec, const Clock& clock) {
  auto job = plan_job(spec, clock);
  if (!job) return job;
  const double start = clock.now();
  job->integrator =
      make_integrator(job->plan.algorithm, *job->scene, *job->camera, job->plan.resolve(spec), std::move(job->parts),
                      job->plan.guided_emission ? job->pilot.emission.guide : EmissionGuide());
  job->load_seconds += clock.now() - start;
  return job;
}

Result<RenderResult> render_job(const RenderRequest& request, const Clock& clock,
                                const std::function<void(const Progress&)>& progress) {
  const int threads =
      request.threads > 0 ? request.threads : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  Result<RenderResult> result = fail(ErrorKind::kInternal, "not run");
  arena.execute([&] {
    auto job = load_job_scene(request.spec, clock);
    result = job ? Rendering(request, *job, clock, progress).run() : tl::unexpected(job.error());
  });
  return result;
}

}  // namespace pf
