#include "jobs/command.h"

#include <algorithm>
#include <array>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "build_id.h"
#include "common/base/nearest_name.h"
#include "common/base/result.h"

namespace pf {
namespace {

constexpr std::array kCommands = {
    Command{"render", "render a job file to EXR, PNG and figures", "photonfarm render JOB.toml --out out",
            run_render_command},
    Command{"plan", "say which algorithm a job would use, and why", "photonfarm plan JOB.toml", run_plan_command},
    Command{"compare", "measure how far an image is from a reference", "photonfarm compare A.exr REF.exr",
            run_compare_command},
    Command{"bench", "chart error against time, for methods and scenes", "photonfarm bench SUITE.toml --out DIR",
            run_bench_command},
    Command{"farm", "run a farm: coordinator, workers and their engine", "photonfarm farm --workers 4",
            run_farm_command},
    Command{"submit", "send a job to a farm", "photonfarm submit JOB.toml --wait --out out", run_submit_command},
    Command{"list", "list the farm's jobs", "photonfarm list --state running", run_list_command},
    Command{"show", "show everything about a job", "photonfarm show JOB", run_show_command},
    Command{"watch", "show a job's progress until it has ended", "photonfarm watch JOB", run_watch_command},
    Command{"logs", "print what was logged about a job", "photonfarm logs JOB --follow", run_logs_command},
    Command{"cancel", "end a job; the image so far stays", "photonfarm cancel JOB", run_cancel_command},
    Command{"pause", "set a job aside; its checkpoint is kept", "photonfarm pause JOB", run_pause_command},
    Command{"resume", "let a paused job go on", "photonfarm resume JOB", run_resume_command},
    Command{"retry", "start a failed or cancelled job again", "photonfarm retry JOB", run_retry_command},
    Command{"extend", "give a job more passes, time or a lower error", "photonfarm extend JOB --passes 1024",
            run_extend_command},
    Command{"set", "change a job's priority or its most workers", "photonfarm set JOB --priority 80", run_set_command},
    Command{"remove", "remove a job that has ended", "photonfarm remove JOB", run_remove_command},
    Command{"units", "list a job's work units", "photonfarm units JOB", run_units_command},
    Command{"validate", "check a job file by the farm's rules", "photonfarm validate JOB.toml", run_validate_command},
    Command{"download", "fetch a job's images and figures", "photonfarm download JOB --out out", run_download_command},
    Command{"verify", "check a result by computing it again", "photonfarm verify IMAGE.exr --scene jobs",
            run_verify_command},
    Command{"estimate", "predict a job's time, memory and network bytes", "photonfarm estimate JOB.toml --error 0.01",
            run_estimate_command},
    Command{"workers", "list, drain, disable and enable workers", "photonfarm workers drain worker-3",
            run_workers_command},
    Command{"token", "make, list and revoke tokens of the service", "photonfarm token create anna --role submit",
            run_token_command},
    Command{"completion", "print a shell's completion script", "source <(photonfarm completion bash)",
            run_completion_command},
    Command{"doctor", "check that this machine can render", "photonfarm doctor", run_doctor_command},
};

std::string help_text() {
  std::string text = fmt::format(
      "photonfarm {}: renders glTF scenes with photon mapping\n\nUsage: photonfarm COMMAND "
      "[ARGUMENTS]\n\nCommands:\n",
      kVersion);
  for (const Command& command : kCommands) text += fmt::format("  {:<12}{}\n", command.name, command.summary);
  text +=
      "\nOptions:\n  -h,--help  this text; after a command, the command's\n  --version  version and build "
      "id\n\nExamples:\n";
  for (const Command& command : kCommands) text += fmt::format("  {}\n", command.example);
  text +=
      "\nExit codes: 0 done; 2 usage or job file; 3 scene or image; 4 farm not reachable; 5 failed or cancelled; 130 "
      "interrupted\n";
  return text;
}

int usage_error(const Context& context, std::string_view who, std::string message, std::string_view help) {
  context.err << fmt::format("{}: {}; see {} --help\n", who, message, help);
  return exit_code(ErrorKind::kUsage);
}

/// The long names of the options, as they are typed.
std::vector<std::string> option_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  for (const CLI::App* subcommand : app.get_subcommands()) {  // those that were given
    const std::vector<std::string> more = option_names(*subcommand);
    names.insert(names.end(), more.begin(), more.end());
  }
  return names;
}

}  // namespace

std::span<const Command> commands() { return kCommands; }

std::optional<int> parse_arguments(CLI::App& app, const Context& context, const Arguments& arguments) {
  if (context.inspect) {
    context.inspect(app);
    return 0;
  }
  Arguments reversed(arguments.rbegin(), arguments.rend());  // CLI11 takes them from the back
  try {
    app.parse(std::move(reversed));
    return std::nullopt;
  } catch (const CLI::CallForHelp&) {
    context.out << app.help();
    return 0;
  } catch (const CLI::ExtrasError& error) {
    std::string message = error.what();
    const std::vector<std::string> valid = option_names(app);
    for (const std::string& argument : arguments) {
      const std::string name = argument.substr(0, argument.find('='));
      if (name.starts_with("--") && std::find(valid.begin(), valid.end(), name) == valid.end()) {
        message = fmt::format("unknown option '{}'", name);
        if (const auto near = nearest_name(name, valid)) message += fmt::format("; did you mean '{}'?", *near);
        break;
      }
    }
    return usage_error(context, app.get_name(), message, app.get_name());
  } catch (const CLI::ParseError& error) {
    return usage_error(context, app.get_name(), error.what(), app.get_name());
  }
}

int run_photonfarm(const Context& context, const Arguments& arguments) {
  if (arguments.empty()) {
    context.err << help_text();
    return exit_code(ErrorKind::kUsage);
  }
  const std::string& name = arguments.front();
  if (name == "-h" || name == "--help") {
    context.out << help_text();
    return 0;
  }
  if (name == "--version") {
    context.out << fmt::format("photonfarm {}\nbuild {}\n", kVersion, kBuildId);
    return 0;
  }
  for (const Command& command : kCommands) {
    if (name == command.name) return command.run(context, Arguments(arguments.begin() + 1, arguments.end()));
  }
  std::vector<std::string_view> names;
  names.reserve(kCommands.size());
  for (const Command& command : kCommands) names.push_back(command.name);
  std::string message = fmt::format("unknown {} '{}'", name.starts_with('-') ? "option" : "command", name);
  if (const auto near = nearest_name(name, std::span<const std::string_view>(names))) {
    message += fmt::format("; did you mean '{}'?", *near);
  }
  return usage_error(context, "photonfarm", message, "photonfarm");
}

}  // namespace pf
