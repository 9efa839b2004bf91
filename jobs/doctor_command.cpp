#include <ostream>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "build_id.h"
#include "common/base/result.h"
#include "jobs/command.h"
#include "jobs/doctor.h"
#include "jobs/state_doctor.h"

namespace pf {

int run_doctor_command(const Context& context, const Arguments& arguments) {
  bool json = false;
  std::string state;
  CLI::App app(
      "Checks that this machine can render: processor, worker, folders, disk, memory, threads. With --state: that a "
      "farm's state folder is whole, and says what to do about what is not. Changes nothing.",
      "photonfarm doctor");
  app.add_option("--state", state, "look through this folder of a farm instead; it may be at work");
  app.add_flag("--json", json, "print one JSON document instead of a table");
  app.footer(
      "Exit code 0 when all is well, 2 when the folder is none of a farm, else 5.\n\n"
      "Examples:\n  photonfarm doctor\n  photonfarm doctor --json\n  photonfarm doctor --state /var/lib/photonfarm");
  if (const std::optional<int> code = parse_arguments(app, context, arguments)) return *code;
  std::vector<Check> checks;
  if (state.empty()) {
    checks = examine({context.folder, context.search_path, context.state, context.temporary, kBuildId});
  } else {
    auto examined = examine_state(std::filesystem::absolute(state), context.temporary, kBuildId);
    if (!examined) {
      context.err << "photonfarm doctor: " << examined.error().message << '\n';
      return exit_code(examined.error().kind);
    }
    checks = std::move(*examined);
  }
  if (json) {
    context.out << doctor_json(checks, kBuildId).dump(2) << '\n';
  } else if (state.empty()) {
    context.out << doctor_text(checks, "This machine can render.", "This machine cannot render yet.");
  } else {
    context.out << doctor_text(checks, "The state folder is whole.", "The state folder needs a hand.");
  }
  return all_well(checks) ? 0 : exit_code(ErrorKind::kInternal);
}

}  // namespace pf
