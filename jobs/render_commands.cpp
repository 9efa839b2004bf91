// render and plan run in photonfarm-worker, which parses their arguments and has their --help.

#include <csignal>
#include <cstring>
#include <ostream>

#include <fmt/format.h>

#include "jobs/command.h"
#include "jobs/process.h"

namespace pf {
namespace {

std::string_view hint_for(int signal) {
  switch (signal) {
    case SIGKILL:
      return "; perhaps the machine ran out of memory: see the kernel's log, or lower image size and threads";
    case SIGILL:
      return "; this processor lacks an instruction: run photonfarm doctor";
    default:
      return "";
  }
}

int run_in_worker(const Context& context, std::string_view command, const Arguments& arguments) {
  Arguments all = {std::string(command)};
  all.insert(all.end(), arguments.begin(), arguments.end());
  const Result<ProcessEnd> end = run_to_end(context.folder / "photonfarm-worker", all);
  if (!end) {
    context.err << fmt::format("photonfarm {}: {}; expected beside photonfarm; run photonfarm doctor\n", command,
                               end.error().message);
    return exit_code(end.error().kind);
  }
  if (end->signal == 0) return end->exit_code;
  if (end->signal == SIGINT) return exit_code(ErrorKind::kInterrupted);
  context.err << fmt::format("photonfarm {}: photonfarm-worker was killed by signal {} ({}){}\n", command, end->signal,
                             sigdescr_np(end->signal), hint_for(end->signal));
  return exit_code(ErrorKind::kInternal);
}

}  // namespace

int run_render_command(const Context& context, const Arguments& arguments) {
  return run_in_worker(context, "render", arguments);
}

int run_plan_command(const Context& context, const Arguments& arguments) {
  return run_in_worker(context, "plan", arguments);
}

}  // namespace pf
