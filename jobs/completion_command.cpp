// Scripts by which shells complete the command's arguments, made from the parsers of the commands themselves.

#include <algorithm>
#include <ostream>
#include <sstream>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/base/cli_tree.h"
#include "jobs/command.h"
#include "jobs/process.h"

namespace pf {
namespace {

using nlohmann::json;

/// A command as it is typed, `farm init`, and what it takes.
struct Completable {
  std::string words;
  std::vector<std::string> options, subcommands;
  std::vector<std::pair<std::string, std::vector<std::string>>> choices;  ///< option, its words
};

void collect(const std::string& words, const json& tree, std::vector<Completable>& all) {
  Completable command{words, {}, {}, {}};
  for (const json& option : tree.at("options")) {
    for (const json& name : option.at("names")) {
      command.options.push_back(name.get<std::string>());
      if (!option.at("choices").empty())
        command.choices.emplace_back(command.options.back(), option.at("choices").get<std::vector<std::string>>());
    }
  }
  const std::size_t at = all.size();
  all.push_back(std::move(command));
  for (const auto& [name, subtree] : tree.at("commands").items()) {
    all[at].subcommands.push_back(name);
    collect(fmt::format("{} {}", words, name), subtree, all);
  }
}

/// The parsers that a command shows when it is asked to do nothing else.
json tree_of(const Context& context, const Command& command, const Arguments& arguments) {
  json tree;
  std::ostringstream nowhere;
  const Context asking{context.folder,
                       context.search_path,
                       context.state,
                       context.temporary,
                       nowhere,
                       nowhere,
                       context.server,
                       context.token,
                       false,
                       context.columns,
                       [&](const CLI::App& app) { tree = cli_tree(app); }};
  static_cast<void>(command.run(asking, arguments));
  return tree;
}

std::vector<Completable> completables(const Context& context) {
  constexpr double kSeconds = 20;
  std::vector<Completable> all;
  json worker;  // render and plan have their parsers there
  if (const auto described = run_and_capture(context.folder / "photonfarm-worker", {"describe-commands"}, kSeconds))
    worker = json::parse(described->output, nullptr, false);
  for (const Command& command : commands()) {
    const std::string name(command.name);
    if (command.run == run_render_command || command.run == run_plan_command) {
      if (worker.is_object() && worker.contains("commands") && worker["commands"].contains(name))
        collect(name, worker["commands"][name], all);
      continue;
    }
    json tree = tree_of(context, command, {});
    if (command.run == run_farm_command) tree["commands"]["init"] = tree_of(context, command, {"init"});
    if (tree.is_object()) collect(name, tree, all);
  }
  return all;
}

std::string joined(const std::vector<std::string>& words) { return fmt::format("{}", fmt::join(words, " ")); }

std::string command_names() {
  std::vector<std::string> names = {"--help", "--version"};
  for (const Command& command : commands()) names.emplace_back(command.name);
  return joined(names);
}

std::string bash_script(const std::vector<Completable>& all) {
  std::string text =
      "# photonfarm's completion for bash: source <(photonfarm completion bash)\n"
      "_photonfarm() {\n"
      "  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD-1]} "
      "command=${COMP_WORDS[1]} words=\n"
      "  COMPREPLY=()\n"
      "  if [ \"$COMP_CWORD\" -eq 1 ]; then\n"
      "    COMPREPLY=($(compgen -W '" +
      command_names() +
      "' -- \"$current\"))\n    return\n  fi\n"
      "  case \"$command ${COMP_WORDS[2]}\" in\n";
  for (const Completable& c : all) {
    if (c.words.find(' ') != std::string::npos)
      text += fmt::format("    '{0}') [ \"$COMP_CWORD\" -gt 2 ] && command='{0}' ;;\n", c.words);
  }
  text += "  esac\n  case \"$command $previous\" in\n";
  for (const Completable& c : all) {
    for (const auto& [option, words] : c.choices)
      text += fmt::format("    '{} {}') words='{}' ;;\n", c.words, option, joined(words));
  }
  text += "    *) case \"$command\" in\n";
  for (const Completable& c : all)
    text += fmt::format("      '{}') words='{} {}' ;;\n", c.words, joined(c.options), joined(c.subcommands));
  return text +
         "    esac ;;\n  esac\n  COMPREPLY=($(compgen -W \"$words\" -- \"$current\"))\n}\n"
         "complete -o default -F _photonfarm photonfarm\n";
}

std::string zsh_script(const std::vector<Completable>& all) {
  // zsh runs bash's functions: one script has one truth.
  return "#compdef photonfarm\n# photonfarm's completion for zsh: source <(photonfarm completion zsh)\n"
         "autoload -U +X bashcompinit && bashcompinit\n" +
         bash_script(all);
}

std::string fish_script(const std::vector<Completable>& all) {
  std::string text = "# photonfarm's completion for fish: photonfarm completion fish | source\n";
  for (const Command& command : commands()) {
    text +=
        fmt::format("complete -c photonfarm -n __fish_use_subcommand -a {} -d \"{}\"\n", command.name, command.summary);
  }
  for (const Completable& c : all) {
    std::string seen;
    for (std::size_t from = 0; from < c.words.size();) {
      const std::size_t space = std::min(c.words.find(' ', from), c.words.size());
      seen += fmt::format("{}__fish_seen_subcommand_from {}", seen.empty() ? "" : "; and ",
                          c.words.substr(from, space - from));
      from = space + 1;
    }
    const std::string begin = fmt::format("complete -c photonfarm -n \"{}\"", seen);
    for (const std::string& subcommand : c.subcommands) text += fmt::format("{} -a {}\n", begin, subcommand);
    for (const std::string& option : c.options) {
      const bool is_long = option.starts_with("--");
      const auto choices = std::ranges::find(c.choices, option, [](const auto& choice) { return choice.first; });
      text +=
          fmt::format("{} {} {}{}\n", begin, is_long ? "-l" : "-s", option.substr(is_long ? 2 : 1),
                      choices == c.choices.end() ? std::string() : fmt::format(" -xa \"{}\"", joined(choices->second)));
    }
  }
  return text;
}

}  // namespace

int run_completion_command(const Context& context, const Arguments& arguments) {
  std::string shell;
  CLI::App app("Prints a script by which a shell completes photonfarm's arguments.", "photonfarm completion");
  app.add_option("SHELL", shell, "bash, zsh or fish")->required()->check(CLI::IsMember({"bash", "zsh", "fish"}));
  app.footer(
      "Examples:\n  source <(photonfarm completion bash)          # in ~/.bashrc; zsh likewise\n"
      "  photonfarm completion fish > ~/.config/fish/completions/photonfarm.fish");
  if (const std::optional<int> code = parse_arguments(app, context, arguments)) return *code;
  const std::vector<Completable> all = completables(context);
  context.out << (shell == "bash" ? bash_script(all) : shell == "zsh" ? zsh_script(all) : fish_script(all));
  return 0;
}

}  // namespace pf
