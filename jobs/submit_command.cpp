#include <filesystem>
#include <ostream>

#include <fmt/format.h>

#include "jobs/client_command.h"
#include "jobs/job_text.h"
#include "jobs/remote_jobs.h"
#include "jobs/submission.h"

namespace pf {
namespace {

using nlohmann::json;

struct SubmitOptions {
  std::string job;
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
  out << fmt::format("{}: valid; {} files, {}B would be sent, less what the service has already\n",
                     spec.job.name, files.size(), short_number(static_cast<double>(bytes)));
  for (const SubmittedFile& file : files)
    out << fmt::format("  {}  {}B\n", file.path, short_number(static_cast<double>(file.id.bytes)));
  return 0;
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
    return command.print({{"job", job},
                          {"exr", files->exr.string()},
                          {"png", files->png.string()},
                          {"json", files->json.string()}});
  }
  command.context().out << fmt::format("{}\n{}\n{}\n", files->exr.string(), files->png.string(),
                                       files->json.string());
  return 0;
}

}  // namespace

int run_submit_command(const Context& context, const Arguments& arguments) {
  SubmitOptions options;
  ClientCommand command(context, "submit",
                        "Sends a job to a farm: its spec, and the files that the service lacks.");
  command.app().add_option("JOB", options.job, "job file (.toml or .json)")->required();
  command.app()
      .add_option("--set", options.overrides, "change a key of the job: --set stop.passes=64")
      ->take_all()
      ->allow_extra_args(false);
  command.app().add_flag(
      "--wait", options.wait,
      "show progress until it has ended, then fetch the images; Ctrl-C leaves the job running");
  command.app()
      .add_option("--out", options.out, "with --wait: folder for <job name>.exr, .png and .json")
      ->capture_default_str();
  command.app().add_flag("--dry-run", options.dry_run, "check the job and list its files; send nothing");
  command.examples(
      "  photonfarm submit jobs/glass-caustic.toml --wait --out out\n"
      "  photonfarm submit job.toml --set stop.passes=256 --server /srv/farm\n"
      "  PHOTONFARM_TOKEN=... photonfarm submit job.toml --server http://10.0.0.5:8080 --json");
  if (const auto code = command.parse(arguments)) return *code;
  const auto spec = load_job(options.job, options.overrides);
  if (!spec) return command.report(spec.error());
  const auto files = hash_files(*spec);
  if (!files) return command.report(files.error());
  if (options.dry_run) return show_dry_run(command, *spec, *files);
  const auto job = submit_job(command.client(), *spec, *files);
  if (!job) {
    if (job.error().kind != ErrorKind::kInterrupted) return command.report(job.error());
    command.note(
        "interrupted before the service said that it took the job; 'photonfarm list' shows whether it did");
    return exit_code(ErrorKind::kInterrupted);
  }
  const std::string id = job_text(*job, "id");
  if (options.wait) {
    command.note("submitted as " + id);
    return wait_and_fetch(command, *job, options.out);
  }
  if (command.json()) return command.print(*job);
  context.out << fmt::format("{}\n", id);
  command.note(fmt::format(
      "submitted; 'photonfarm watch {0}' shows it, 'photonfarm download {0}' fetches the result", id));
  return 0;
}

}  // namespace pf
