#include "jobs/benchmark/schedule.h"

#include <random>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"
#include "jobs/submission.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

constexpr int kFormat = 1;  // of what a run leaves; part of its id

tl::unexpected<Error> cannot_copy(const fs::path& file, const std::error_code& code) {
  return fail(ErrorKind::kInternal, fmt::format("{}: cannot be written: {}", file.string(), code.message()));
}

Result<Scene> prepare_scene(const SceneEntry& entry, const fs::path& out) {
  Scene scene{entry.name, entry.job, entry.set, {}, {}, entry.reference, 0};
  if (entry.width > 0) scene.set.push_back(fmt::format("image.width={}", entry.width));
  if (entry.height > 0) scene.set.push_back(fmt::format("image.height={}", entry.height));
  auto spec = load_job(scene.job, scene.set);
  if (!spec) return tl::unexpected(spec.error());
  scene.exposure = spec->image.exposure;
  std::vector<SubmittedFile> files;
  if (!entry.gltf.empty()) {
    spec->folder = entry.gltf.parent_path();
    spec->scene.file = entry.gltf.filename().string();
    auto job = lay_out(*spec, out / "scenes" / entry.name, files);
    if (job) {
      scene.job = *job;
    } else {
      scene.error = job.error().message;
    }
  } else {
    auto hashed = hash_files(*spec);
    if (hashed) {
      files = std::move(*hashed);
    } else {
      scene.error = hashed.error().message;
    }
  }
  std::string names;
  for (const SubmittedFile& file : files) names += fmt::format("{} {}\n", file.path, file.id.sha256);
  scene.hash = sha256_hex(names);
  return scene;
}

void shuffle(std::vector<Run>& runs, std::size_t first, std::mt19937_64& random) {
  for (std::size_t i = runs.size() - 1; i > first; --i) {
    std::swap(runs[i], runs[first + random() % (i - first + 1)]);  // Fisher and Yates: the same order everywhere
  }
}

}  // namespace

Result<fs::path> lay_out(const JobSpec& spec, const fs::path& folder, std::vector<SubmittedFile>& files) {
  auto hashed = hash_files(spec);
  if (!hashed) return tl::unexpected(hashed.error());
  files = std::move(*hashed);
  for (const SubmittedFile& file : files) {
    const fs::path to = folder / file.path;
    std::error_code code;
    fs::create_directories(to.parent_path(), code);
    if (!code) fs::copy_file(file.source, to, fs::copy_options::overwrite_existing, code);
    if (code) return cannot_copy(to, code);
  }
  fs::path job = folder / "job.json";
  if (auto written = write_file_atomically(job, canonical_json(spec)); !written) return tl::unexpected(written.error());
  return job;
}

Result<Run> make_run(const Suite& suite, const Scene& scene, const MethodEntry& method, std::uint64_t seed,
                     const std::string& build, const fs::path& out) {
  Run run;
  run.seed = seed;
  RenderOrder& order = run.order;
  order.job = scene.job;
  order.set = scene.set;
  order.set.insert(order.set.end(), method.set.begin(), method.set.end());
  const std::vector<std::string> own = {
      fmt::format("job.name={}", kImageName),
      fmt::format("integrator.type={}", method.type),
      fmt::format("integrator.seed={}", seed),
      fmt::format("stop.seconds={}", suite.by_seconds() ? suite.seconds.back() : 0.0),
      fmt::format("stop.passes={}", suite.by_seconds() ? 0 : suite.passes.back()),
      "checkpoint.seconds=1000000000"};  // none but the last, which comes after the last image
  order.set.insert(order.set.end(), own.begin(), own.end());
  order.snapshot_seconds = suite.seconds;
  order.snapshot_passes = suite.passes;
  order.processor_time = suite.time == TimeAxis::kCpu;
  order.threads = suite.threads;
  const double last = suite.by_seconds() ? suite.seconds.back() : 600.0;
  order.timeout = suite.timeout > 0 ? suite.timeout : 10 * last + 60;
  auto identity = identity_of_job(order.job, order.set);
  if (!identity) return tl::unexpected(identity.error());
  const nlohmann::json key = {
      {"format", kFormat},        {"scene", scene.hash},        {"job", *identity},
      {"seconds", suite.seconds}, {"passes", suite.passes},     {"threads", suite.threads},
      {"build", build},           {"scene_error", scene.error}, {"processor_time", order.processor_time}};
  run.id = sha256_hex(key.dump()).substr(0, 20);
  run.order.out = out / "runs" / run.id;
  return run;
}

Result<std::string> identity_of_job(const fs::path& job, const std::vector<std::string>& set) {
  const auto spec = load_job(job, set);
  if (!spec) return tl::unexpected(spec.error());
  auto document = nlohmann::json::parse(canonical_json(*spec));
  document.erase("job");
  return document.dump();
}

Result<std::vector<Scene>> prepare_scenes(const Suite& suite, const fs::path& out) {
  std::vector<Scene> scenes;
  for (const SceneEntry& entry : suite.scenes) {
    auto scene = prepare_scene(entry, out);
    if (!scene) return tl::unexpected(scene.error());
    scenes.push_back(std::move(*scene));
  }
  return scenes;
}

Result<std::vector<Run>> make_schedule(const Suite& suite, const std::vector<Scene>& scenes, const std::string& build,
                                       const fs::path& out) {
  std::vector<Run> runs;
  std::mt19937_64 random(suite.shuffle);
  for (int repetition = 0; repetition < suite.repetitions; ++repetition) {
    const std::size_t first = runs.size();
    for (std::size_t s = 0; s < scenes.size(); ++s) {
      for (std::size_t m = 0; m < suite.methods.size(); ++m) {
        const std::uint64_t seed = suite.first_seed + static_cast<std::uint64_t>(repetition);
        auto run = make_run(suite, scenes[s], suite.methods[m], seed, build, out);
        if (!run) {
          return fail(run.error().kind, fmt::format("method '{}' on scene '{}': {}", suite.methods[m].name,
                                                    scenes[s].name, run.error().message));
        }
        run->scene = s;
        run->method = m;
        run->repetition = repetition;
        runs.push_back(std::move(*run));
      }
    }
    shuffle(runs, first, random);
  }
  return runs;
}

}  // namespace pf::bench
