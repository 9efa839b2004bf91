#include <ostream>

#include <fmt/format.h>

#include "jobs/client_command.h"
#include "jobs/job_text.h"

namespace pf {
namespace {

using nlohmann::json;

/// Tells the service about each of these workers.
int tell(ClientCommand& command, const std::vector<std::string>& names, const std::string& action) {
  json workers = json::array();
  for (const std::string& name : names) {
    const auto worker =
        command.client().ask({.method = "POST", .path = fmt::format("/v1/workers/{}/{}", name, action)}, false);
    if (!worker) return command.report(worker.error());
    if (!command.json()) command.context().out << fmt::format("{} {}\n", name, job_text(*worker, "state"));
    workers.push_back(*worker);
  }
  return command.json() ? command.print({{"workers", workers}}) : 0;
}

}  // namespace

int run_workers_command(const Context& context, const Arguments& arguments) {
  std::vector<std::string> names;
  ClientCommand command(context, "workers", "Lists the farm's workers and what they do, or sends some of them away.");
  CLI::App& app = command.app();
  app.require_subcommand(0, 1);
  app.add_subcommand("list", "list them; what happens without a word")->fallthrough();
  const std::pair<const char*, const char*> actions[] = {
      {"drain", "let a worker finish what it has, then give it nothing; it ends"},
      {"disable", "give a worker nothing until it is enabled again"},
      {"enable", "give a worker work again, also one in quarantine"}};
  const CLI::Validator is_name(
      [](const std::string& text) {
        return is_worker_name(text) ? "" : "expected a worker's name: A-Z, a-z, 0-9, - and _";
      },
      "");
  for (const auto& [name, help] : actions) {
    CLI::App& action = *app.add_subcommand(name, help)->fallthrough();
    action.add_option("NAME", names, "workers' names")->required()->check(is_name);
    action.footer(fmt::format("Example:\n  photonfarm workers {} worker-3", name));
  }
  command.examples("  photonfarm workers\n  photonfarm workers --json\n  photonfarm workers drain worker-3 worker-4");
  if (const auto code = command.parse(arguments)) return *code;
  for (const auto& [name, help] : actions) {
    if (app.got_subcommand(name)) return tell(command, names, name);
  }
  const auto reply = command.client().ask({.path = "/v1/workers"}, false);
  if (!reply) return command.report(reply.error());
  if (command.json()) return command.print(*reply);
  context.out << workers_table(reply->value("workers", json::array()));
  return 0;
}

}  // namespace pf
