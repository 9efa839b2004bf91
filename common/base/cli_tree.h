#pragma once

#include <algorithm>
#include <string>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

namespace pf {

/// What a command line takes, for whoever completes it: {"options": [{"names", "takes", "choices"}],
/// "commands": {name: tree}}. Read from the parser itself, so that it cannot say something else.
[[nodiscard]] inline nlohmann::json cli_tree(const CLI::App& app) {
  nlohmann::json options = nlohmann::json::array();
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_positional()) continue;
    nlohmann::json names = nlohmann::json::array();
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    for (const std::string& name : option->get_snames()) names.push_back("-" + name);
    // CLI11 tells a set of valid words only in the text of its type: TEXT:{one,two}.
    const std::string type = option->get_type_name();
    const std::size_t open = type.find('{'), close = type.find('}');
    nlohmann::json choices = nlohmann::json::array();
    for (std::size_t from = open + 1; open != std::string::npos && close != std::string::npos && from < close;) {
      const std::size_t comma = std::min(type.find(',', from), close);
      choices.push_back(type.substr(from, comma - from));
      from = comma + 1;
    }
    options.push_back({{"names", names}, {"takes", option->get_items_expected_max() > 0}, {"choices", choices}});
  }
  nlohmann::json commands = nlohmann::json::object();
  for (const CLI::App* command : app.get_subcommands({})) commands[command->get_name()] = cli_tree(*command);
  return {{"options", options}, {"commands", commands}};
}

}  // namespace pf
