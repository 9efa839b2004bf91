// list, show, watch, cancel and download: one question to the service each, or a few.

#include <algorithm>
#include <ostream>

#include <fmt/format.h>

#include "jobs/client_command.h"
#include "jobs/job_text.h"
#include "jobs/remote_jobs.h"

namespace pf {
namespace {

using nlohmann::json;

/// Draws a table of all jobs again and again, or writes it whenever it changed, until the user stops it; elsewhere than
/// on a terminal until all jobs have ended.
int watch_all(ClientCommand& command, double interval) {
  const Context& context = command.context();
  std::string shown;
  while (true) {
    const auto listed = list_jobs(command.client(), "", true);
    if (!listed) return listed.error().kind == ErrorKind::kInterrupted ? 0 : command.report(listed.error());
    const json& jobs = *listed;
    const std::string table = jobs_table(jobs);
    constexpr const char* kClear = "\x1b[H\x1b[2J";  // cursor home, erase the screen [ECMA-48, 8.3.21 and 8.3.39]
    if (context.terminal) context.err << kClear << table << "\nCtrl-C ends the watching, not the jobs\n" << std::flush;
    if (!context.terminal && table != shown) context.err << table << std::flush;
    shown = table;
    const bool all_ended = std::all_of(jobs.begin(), jobs.end(), job_has_ended);
    if (!context.terminal && all_ended) return command.json() ? command.print({{"jobs", jobs}}) : 0;
    if (!command.client().pause(interval)) return 0;
  }
}

}  // namespace

int run_list_command(const Context& context, const Arguments& arguments) {
  std::string state, name;
  bool active = false;
  std::size_t last = 0;
  ClientCommand command(context, "list", "Lists the farm's jobs.");
  command.app()
      .add_option("--state", state, "only jobs in this state")
      ->check(CLI::IsMember(
          {"queued", "preparing", "running", "paused", "waiting", "finishing", "done", "failed", "cancelled"}));
  command.app().add_option("--name", name, "only jobs of this name");
  command.app().add_flag("--active", active, "only jobs that have not ended");
  command.app().add_option("--last", last, "only so many, those submitted last")->check(CLI::Range(1, 1000000));
  command.examples("  photonfarm list\n  photonfarm list --active\n  photonfarm list --state failed --last 20 --json");
  if (const auto code = command.parse(arguments)) return *code;
  const auto listed = list_jobs(command.client(), state, false);
  if (!listed) return command.report(listed.error());
  json jobs = json::array();
  for (const json& job : *listed) {
    if ((name.empty() || job_text(job, "name") == name) && !(active && job_has_ended(job))) jobs.push_back(job);
  }
  if (last > 0 && jobs.size() > last) jobs.erase(jobs.begin(), jobs.end() - static_cast<std::ptrdiff_t>(last));
  if (command.json()) return command.print({{"jobs", jobs}});
  context.out << jobs_table(jobs);
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
  double interval = 1;
  ClientCommand command(context, "watch",
                        "Shows a job's progress until it has ended; without a job, a table of all of them.");
  command.app().add_option("JOB", what, kJobHelp);
  command.app()
      .add_option("--interval", interval, "seconds between two tables")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  command.examples("  photonfarm watch glass-caustic\n  photonfarm watch --interval 5");
  if (const auto code = command.parse(arguments)) return *code;
  if (what.empty()) return watch_all(command, interval);
  auto job = find_job(command.client(), what, true);
  if (!job) return command.report(job.error());
  const int code = command.watch(*job);
  if (command.json() && job_has_ended(*job)) command.print(*job);
  return code;
}

int run_cancel_command(const Context& context, const Arguments& arguments) {
  std::string what;
  bool discard = false;
  ClientCommand command(context, "cancel", "Ends a job; the image so far can be downloaded.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.app().add_flag("--discard", discard, "keep neither image nor checkpoint");
  command.examples("  photonfarm cancel glass-caustic\n  photonfarm cancel glass-caustic --discard");
  if (const auto code = command.parse(arguments)) return *code;
  const auto found = find_job(command.client(), what, false);
  if (!found) return command.report(found.error());
  const std::string id = job_text(*found, "id");
  const auto job = command.client().ask(
      {.method = "POST", .path = "/v1/jobs/" + id + "/cancel", .body = discard ? R"({"discard": true})" : ""}, false);
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
  command.app().add_option("--out", folder, "folder for <job name>.exr, .png and .json")->capture_default_str();
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
    return command.print(
        {{"job", *job}, {"exr", files->exr.string()}, {"png", files->png.string()}, {"json", files->json.string()}});
  }
  context.out << fmt::format("{}\n{}\n{}\n", files->exr.string(), files->png.string(), files->json.string());
  return 0;
}

}  // namespace pf
