#include <filesystem>
#include <ostream>

#include <fmt/format.h>

#include "jobs/client_command.h"
#include "jobs/job_text.h"
#include "jobs/provenance.h"
#include "jobs/remote_jobs.h"
#include "jobs/submission.h"

namespace pf {
namespace {

using nlohmann::json;

struct SubmitOptions {
  std::string job, from, scene;
  std::vector<std::string> overrides;
  std::string out = "out";
  bool wait = false, dry_run = false;
};

int show_dry_run(const ClientCommand& command, const JobSpec& spec, const std::vector<SubmittedFile>& files) {
  std::uint64_t bytes = 0;
  json listed = json::array();
  for (const SubmittedFile& file : files) {
    bytes += file.id.bytes;
    listed.push_back({{"path", file.path}, {"sha256", file.id.sha256}, {"bytes", file.id.bytes}});
  }
  if (command.json()) {
    return command.print({{"spec", json::parse(canonical_json(spec))}, {"files", listed}, {"bytes", bytes}});
  }
  std::ostream& out = command.context().out;
  out << fmt::format("{}: valid; {} files, {}B would be sent, less what the service has already\n", spec.job.name,
                     files.size(), short_number(static_cast<double>(bytes)));
  for (const SubmittedFile& file : files)
    out << fmt::format("  {}  {}B\n", file.path, short_number(static_cast<double>(file.id.bytes)));
  return 0;
}

struct Prepared {
  JobSpec spec;
  std::vector<SubmittedFile> files;
  bool known = false;  ///< the files are not here: the service is to have them
};

/// The job of a file, or that of an image.
Result<Prepared> prepare(const SubmitOptions& options) {
  if (options.job.empty() == options.from.empty())
    return fail(ErrorKind::kUsage, "expected a job file, or --from with an image, and not both");
  Prepared prepared;
  if (options.from.empty()) {
    auto spec = load_job(options.job, options.overrides);
    if (!spec) return tl::unexpected(spec.error());
    prepared.spec = std::move(*spec);
  } else {
    if (!options.overrides.empty())
      return fail(ErrorKind::kUsage, "--set changes the job; --from is to render the same again");
    auto origin = read_origin(options.from);
    if (!origin) return tl::unexpected(origin.error());
    if (options.scene.empty() && origin->files.empty())
      return fail(ErrorKind::kInvalidInput,
                  options.from + ": does not list its scene's files; expected --scene FOLDER");
    if (!options.scene.empty()) {
      if (auto used = use_scene_folder(*origin, options.scene); !used) return tl::unexpected(used.error());
    }
    prepared.spec = std::move(origin->spec);
    if (options.scene.empty()) {
      prepared.known = true;
      for (const auto& [path, id] : origin->files) prepared.files.push_back({path, {}, id});
      return prepared;
    }
  }
  auto files = hash_files(prepared.spec);
  if (!files) return tl::unexpected(files.error());
  prepared.files = std::move(*files);
  return prepared;
}

int wait_and_fetch(ClientCommand& command, json job, const std::string& folder) {
  const std::string id = job_text(job, "id");
  if (const int code = command.watch(job); code != 0) {
    if (command.json() && job_has_ended(job)) command.print(job);
    return code;
  }
  const auto files = download_job(command.client(), job, folder);
  if (!files) {
    const int code = command.report(files.error());
    command.note(fmt::format("'photonfarm download {} --out {}' fetches the result", id, folder));
    return code;
  }
  if (command.json()) {
    return command.print(
        {{"job", job}, {"exr", files->exr.string()}, {"png", files->png.string()}, {"json", files->json.string()}});
  }
  command.context().out << fmt::format("{}\n{}\n{}\n", files->exr.string(), files->png.string(), files->json.string());
  return 0;
}

}  // namespace

int run_submit_command(const Context& context, const Arguments& arguments) {
  SubmitOptions options;
  ClientCommand command(context, "submit", "Sends a job to a farm: its spec, and the files that the service lacks.");
  command.app().add_option("JOB", options.job, "job file (.toml or .json)");
  command.app().add_option(
      "--from", options.from,
      "instead of a job file: an EXR that photonfarm wrote, to be rendered again to the same bits");
  command.app()
      .add_option("--scene", options.scene, "with --from: folder with the scene's files; default: the service has them")
      ->check(CLI::ExistingDirectory);
  command.app()
      .add_option("--set", options.overrides, "change a key of the job: --set stop.passes=64")
      ->take_all()
      ->allow_extra_args(false);
  command.app().add_flag("--wait", options.wait,
                         "show progress until it has ended, then fetch the images; Ctrl-C leaves the job running");
  command.app()
      .add_option("--out", options.out, "with --wait: folder for <job name>.exr, .png and .json")
      ->capture_default_str();
  command.app().add_flag("--dry-run", options.dry_run, "check the job and list its files; send nothing");
  command.examples(
      "  photonfarm submit jobs/glass-caustic.toml --wait --out out\n"
      "  photonfarm submit --from out/glass-caustic.exr --wait --out again\n"
      "  photonfarm submit job.toml --set stop.passes=256 --server /srv/farm\n"
      "  PHOTONFARM_TOKEN=... photonfarm submit job.toml --server http://10.0.0.5:8080 --json");
  if (const auto code = command.parse(arguments)) return *code;
  const auto prepared = prepare(options);
  if (!prepared) return command.report(prepared.error());
  const auto& [spec, files, known] = *prepared;
  if (options.dry_run) return show_dry_run(command, spec, files);
  const auto job =
      known ? submit_known_files(command.client(), spec, files) : submit_job(command.client(), spec, files);
  if (!job) {
    if (job.error().kind != ErrorKind::kInterrupted) return command.report(job.error());
    command.note("interrupted before the service said that it took the job; 'photonfarm list' shows whether it did");
    return exit_code(ErrorKind::kInterrupted);
  }
  const std::string id = job_text(*job, "id");
  if (options.wait) {
    command.note("submitted as " + id);
    return wait_and_fetch(command, *job, options.out);
  }
  if (command.json()) return command.print(*job);
  context.out << fmt::format("{}\n", id);
  command.note(
      fmt::format("submitted; 'photonfarm watch {0}' shows it, 'photonfarm download {0}' fetches the result", id));
  return 0;
}

}  // namespace pf
