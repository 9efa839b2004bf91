#include <ostream>

#include <fmt/format.h>

#include "jobs/client_command.h"
#include "jobs/job_text.h"

namespace pf {
namespace {

using nlohmann::json;

int create_token(ClientCommand& command, const std::string& name, const std::string& role) {
  const json body = {{"name", name}, {"role", role}};
  const auto token = command.client().ask({.method = "POST", .path = "/v1/tokens", .body = body.dump()}, false);
  if (!token) return command.report(token.error());
  if (command.json()) return command.print(*token);
  command.context().out << job_text(*token, "token") << '\n';
  command.note("keep it: nobody can show it again; PHOTONFARM_TOKEN hands it to the commands");
  return 0;
}

int list_tokens(ClientCommand& command) {
  const auto reply = command.client().ask({.path = "/v1/tokens"}, false);
  if (!reply) return command.report(reply.error());
  if (command.json()) return command.print(*reply);
  command.context().out << tokens_table(reply->value("tokens", json::array()));
  return 0;
}

int revoke_token(ClientCommand& command, const std::string& name) {
  const auto reply = command.client().call({.method = "DELETE", .path = "/v1/tokens/" + name});
  if (!reply) return command.report(reply.error());
  if (const auto checked = command.client().check(*reply); !checked) return command.report(checked.error());
  if (command.json()) return command.print({{"revoked", name}});
  command.context().out << fmt::format("{} revoked\n", name);
  return 0;
}

}  // namespace

int run_token_command(const Context& context, const Arguments& arguments) {
  std::string name, role = "submit";
  ClientCommand command(context, "token", "Makes, lists and revokes the tokens that open the service to others.");
  CLI::App& app = command.app();
  app.require_subcommand(1);
  CLI::App& create = *app.add_subcommand("create", "make a token and print it, once")->fallthrough();
  create.add_option("NAME", name, "whose or what for: a-z, 0-9 and -")->required();
  create.add_option("--role", role, "read: look; submit: send and steer jobs too; admin: everything")
      ->check(CLI::IsMember({"read", "submit", "admin"}))
      ->capture_default_str();
  create.footer("Example:\n  PHOTONFARM_TOKEN=$(photonfarm token create anna --role submit)");
  CLI::App& list = *app.add_subcommand("list", "list names and roles")->fallthrough();
  CLI::App& revoke = *app.add_subcommand("revoke", "make a token open nothing any more")->fallthrough();
  revoke.add_option("NAME", name, "the token's name")
      ->required()
      ->check(CLI::Validator(
          [](const std::string& text) { return is_path_segment(text) ? "" : "expected a-z, 0-9 and -"; }, ""));
  command.examples(
      "  photonfarm token create anna --role submit\n  photonfarm token list\n  photonfarm token revoke "
      "anna");
  if (const auto code = command.parse(arguments)) return *code;
  if (create.parsed()) return create_token(command, name, role);
  return list.parsed() ? list_tokens(command) : revoke_token(command, name);
}

}  // namespace pf
