// pause, resume, retry, extend, set, units and validate: what steers a job on a farm or looks closely at one.

#include <optional>
#include <ostream>

#include <fmt/format.h>

#include "jobs/client_command.h"
#include "jobs/job_text.h"
#include "jobs/remote_jobs.h"
#include "jobs/submission.h"

namespace pf {
namespace {

using nlohmann::json;

/// Asks the service to do something with the job that `what` means, and shows the job as it is then.
int steer(ClientCommand& command, const std::string& what, const std::string& method, const std::string& action,
          const json& body = nullptr) {
  const auto found = find_job(command.client(), what, false);
  if (!found) return command.report(found.error());
  const std::string id = job_text(*found, "id");
  const auto job = command.client().ask(
      {.method = method, .path = "/v1/jobs/" + id + action, .body = body.is_null() ? std::string() : body.dump()},
      false);
  if (!job) return command.report(job.error());
  if (command.json()) return command.print(*job);
  const std::string message = job_text(*job, "message");
  command.context().out << fmt::format("{} {}{}{}\n", id, job_text(*job, "state"), message.empty() ? "" : ": ",
                                       message);
  return 0;
}

int run_simple(const Context& context, const Arguments& arguments, const std::string& verb,
               const std::string& summary) {
  std::string what;
  ClientCommand command(context, verb, summary);
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.examples(fmt::format("  photonfarm {0} glass-caustic\n  photonfarm {0} glass-caustic --json", verb));
  if (const auto code = command.parse(arguments)) return *code;
  return steer(command, what, "POST", "/" + verb);
}

}  // namespace

int run_pause_command(const Context& context, const Arguments& arguments) {
  return run_simple(context, arguments, "pause",
                    "Pauses a job: its checkpoint is written, its workers turn to others.");
}

int run_resume_command(const Context& context, const Arguments& arguments) {
  return run_simple(context, arguments, "resume", "Lets a paused job go on, to the same bits.");
}

int run_retry_command(const Context& context, const Arguments& arguments) {
  return run_simple(context, arguments, "retry", "Starts a failed or cancelled job again from its checkpoint.");
}

int run_extend_command(const Context& context, const Arguments& arguments) {
  std::string what;
  std::optional<std::int64_t> passes;
  std::optional<double> seconds, error;
  ClientCommand command(context, "extend",
                        "Gives a job new stop conditions; one that is done goes on, and its image becomes "
                        "that of one\nlong run, to the bit.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.app().add_option("--passes", passes, "stop.passes: more than it has")->check(CLI::Range(1.0, 1e15));
  command.app().add_option("--seconds", seconds, "stop.seconds; 0: no bound")->check(CLI::Range(0.0, 1e15));
  command.app().add_option("--error", error, "stop.error; 0: no bound")->check(CLI::Range(0.0, 1e15));
  command.examples(
      "  photonfarm extend glass-caustic --passes 1024\n  photonfarm extend glass-caustic --error 0.01 "
      "--seconds 600");
  if (const auto code = command.parse(arguments)) return *code;
  json body = json::object();
  if (passes) body["passes"] = *passes;
  if (seconds) body["seconds"] = *seconds;
  if (error) body["error"] = *error;
  if (body.empty()) return command.report({ErrorKind::kUsage, "expected --passes, --seconds or --error"});
  return steer(command, what, "POST", "/extend", body);
}

int run_set_command(const Context& context, const Arguments& arguments) {
  std::string what;
  std::optional<int> priority, workers;
  ClientCommand command(context, "set",
                        "Changes what a job may have of the farm; ten points of priority double its share.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.app().add_option("--priority", priority, "0 to 100; 50 is usual")->check(CLI::Range(0, 100));
  command.app()
      .add_option("--max-workers", workers, "workers that may trace for it at a time; 0: no bound")
      ->check(CLI::Range(0, 1000000));
  command.examples("  photonfarm set glass-caustic --priority 80\n  photonfarm set glass-caustic --max-workers 4");
  if (const auto code = command.parse(arguments)) return *code;
  json body = json::object();
  if (priority) body["priority"] = *priority;
  if (workers) body["max_workers"] = *workers;
  if (body.empty()) return command.report({ErrorKind::kUsage, "expected --priority or --max-workers"});
  return steer(command, what, "PATCH", "", body);
}

int run_remove_command(const Context& context, const Arguments& arguments) {
  std::string what;
  ClientCommand command(context, "remove", "Removes a job that has ended, its image and its checkpoint.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.examples("  photonfarm remove glass-caustic");
  if (const auto code = command.parse(arguments)) return *code;
  const auto found = find_job(command.client(), what, false);
  if (!found) return command.report(found.error());
  const std::string id = job_text(*found, "id");
  const auto reply = command.client().call({.method = "DELETE", .path = "/v1/jobs/" + id});
  if (!reply) return command.report(reply.error());
  if (const auto checked = command.client().check(*reply); !checked) return command.report(checked.error());
  if (command.json()) return command.print({{"removed", id}});
  context.out << fmt::format("{} removed\n", id);
  return 0;
}

int run_units_command(const Context& context, const Arguments& arguments) {
  std::string what;
  ClientCommand command(context, "units",
                        "Lists a job's work units: who has or had each, how long it took, the hash of its sums.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.examples("  photonfarm units glass-caustic\n  photonfarm units glass-caustic --json");
  if (const auto code = command.parse(arguments)) return *code;
  const auto found = find_job(command.client(), what, false);
  if (!found) return command.report(found.error());
  const auto units = all_units(command.client(), job_text(*found, "id"));
  if (!units) return command.report(units.error());
  if (command.json()) return command.print({{"units", *units}});
  context.out << units_table(*units);
  return 0;
}

int run_validate_command(const Context& context, const Arguments& arguments) {
  std::string job;
  std::vector<std::string> overrides;
  ClientCommand command(context, "validate",
                        "Checks a job file: here, and by the farm's own rules. Sends its spec, none of its files.");
  command.app().add_option("JOB", job, "job file (.toml or .json)")->required();
  command.app()
      .add_option("--set", overrides, "change a key of the job: --set stop.passes=64")
      ->take_all()
      ->allow_extra_args(false);
  command.examples(
      "  photonfarm validate jobs/glass-caustic.toml\n  photonfarm validate job.toml --set stop.passes=256 "
      "--json");
  if (const auto code = command.parse(arguments)) return *code;
  const auto spec = load_job(job, overrides);
  if (!spec) return command.report(spec.error());
  const auto files = hash_files(*spec);
  if (!files) return command.report(files.error());
  const auto reply = command.client().ask(
      {.method = "POST", .path = "/v1/jobs/validate", .body = submission_body(*spec, *files).dump()}, false);
  if (!reply) return command.report(reply.error());
  if (command.json()) return command.print(*reply);
  context.out << fmt::format("{}: valid\n", job);
  for (const json& warning : reply->value("warnings", json::array())) {
    if (warning.is_string()) context.err << "warning: " << warning.get<std::string>() << '\n';
  }
  return 0;
}

}  // namespace pf
