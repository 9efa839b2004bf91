// list, show, watch, cancel, download and workers: one question to the service each, or a few.

#include <ostream>

#include <fmt/format.h>

#include "jobs/client_command.h"
#include "jobs/job_text.h"
#include "jobs/remote_jobs.h"

namespace pf {
namespace {

using nlohmann::json;

constexpr const char* kJobHelp = "the job: its id, the begin of it, or its name (the one submitted last)";

}  // namespace

int run_list_command(const Context& context, const Arguments& arguments) {
  std::string state;
  ClientCommand command(context, "list", "Lists the farm's jobs.");
  command.app()
      .add_option("--state", state, "only jobs in this state")
      ->check(CLI::IsMember(
          {"queued", "preparing", "running", "waiting", "finishing", "done", "failed", "cancelled"}));
  command.examples("  photonfarm list\n  photonfarm list --state running --json");
  if (const auto code = command.parse(arguments)) return *code;
  const auto reply =
      command.client().ask({.path = state.empty() ? "/v1/jobs" : "/v1/jobs?state=" + state}, false);
  if (!reply) return command.report(reply.error());
  if (command.json()) return command.print(*reply);
  context.out << jobs_table(reply->value("jobs", json::array()));
  return 0;
}

int run_show_command(const Context& context, const Arguments& arguments) {
  std::string what;
  ClientCommand command(context, "show", "Shows everything that the farm knows about a job.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.examples("  photonfarm show glass-caustic\n  photonfarm show glass-caustic --json");
  if (const auto code = command.parse(arguments)) return *code;
  const auto job = find_job(command.client(), what, false);
  if (!job) return command.report(job.error());
  if (command.json()) return command.print(*job);
  context.out << job_description(*job);
  return 0;
}

int run_watch_command(const Context& context, const Arguments& arguments) {
  std::string what;
  ClientCommand command(context, "watch", "Shows a job's progress until it has ended.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.examples("  photonfarm watch glass-caustic");
  if (const auto code = command.parse(arguments)) return *code;
  auto job = find_job(command.client(), what, true);
  if (!job) return command.report(job.error());
  const int code = command.watch(*job);
  if (command.json() && job_has_ended(*job)) command.print(*job);
  return code;
}

int run_cancel_command(const Context& context, const Arguments& arguments) {
  std::string what;
  ClientCommand command(context, "cancel", "Ends a job; the image so far can be downloaded.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.examples("  photonfarm cancel glass-caustic");
  if (const auto code = command.parse(arguments)) return *code;
  const auto found = find_job(command.client(), what, false);
  if (!found) return command.report(found.error());
  const std::string id = job_text(*found, "id");
  const auto job = command.client().ask({.method = "POST", .path = "/v1/jobs/" + id + "/cancel"}, false);
  if (!job) return command.report(job.error());
  if (command.json()) return command.print(*job);
  const bool had_ended = job_has_ended(*found);
  context.out << fmt::format("{} {}{}\n", id, had_ended ? "had ended: " : "", job_text(*job, "state"));
  return 0;
}

int run_download_command(const Context& context, const Arguments& arguments) {
  std::string what, folder = "out";
  ClientCommand command(context, "download",
                        "Fetches a job's images and figures; goes on where an earlier try broke off.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.app()
      .add_option("--out", folder, "folder for <job name>.exr, .png and .json")
      ->capture_default_str();
  command.examples("  photonfarm download glass-caustic --out out");
  if (const auto code = command.parse(arguments)) return *code;
  const auto job = find_job(command.client(), what, true);
  if (!job) return command.report(job.error());
  const auto files = download_job(command.client(), *job, folder);
  if (!files && files.error().kind == ErrorKind::kInterrupted) {
    command.note("interrupted; the same command goes on from here");
    return exit_code(ErrorKind::kInterrupted);
  }
  if (!files) return command.report(files.error());
  if (command.json()) {
    return command.print({{"job", *job},
                          {"exr", files->exr.string()},
                          {"png", files->png.string()},
                          {"json", files->json.string()}});
  }
  context.out << fmt::format("{}\n{}\n{}\n", files->exr.string(), files->png.string(), files->json.string());
  return 0;
}

int run_workers_command(const Context& context, const Arguments& arguments) {
  ClientCommand command(context, "workers", "Lists the farm's workers and what they do.");
  command.examples("  photonfarm workers\n  photonfarm workers --json");
  if (const auto code = command.parse(arguments)) return *code;
  const auto reply = command.client().ask({.path = "/v1/workers"}, false);
  if (!reply) return command.report(reply.error());
  if (command.json()) return command.print(*reply);
  context.out << workers_table(reply->value("workers", json::array()));
  return 0;
}

}  // namespace pf
