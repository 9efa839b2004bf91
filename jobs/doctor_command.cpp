#include <ostream>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "build_id.h"
#include "common/base/result.h"
#include "jobs/command.h"
#include "jobs/doctor.h"

namespace pf {

int run_doctor_command(const Context& context, const Arguments& arguments) {
  bool json = false;
  CLI::App app("Checks that this machine can render: processor, worker, folders, disk, memory, threads.",
               "photonfarm doctor");
  app.add_flag("--json", json, "print one JSON document instead of a table");
  app.footer(
      "Exit code 0 when it can, else 5.\n\nExamples:\n  photonfarm doctor\n  photonfarm doctor --json");
  if (const std::optional<int> code = parse_arguments(app, context, arguments)) return *code;
  const std::vector<Check> checks =
      examine({context.folder, context.search_path, context.state, context.temporary, kBuildId});
  if (json) {
    context.out << doctor_json(checks, kBuildId).dump(2) << '\n';
  } else {
    context.out << doctor_text(checks);
  }
  return all_well(checks) ? 0 : exit_code(ErrorKind::kInternal);
}

}  // namespace pf
