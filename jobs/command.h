#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App;
}

namespace pf {

/// What main() found out about its surroundings; commands read neither environment variables nor /proc
/// themselves.
struct Context {
  std::filesystem::path folder;     ///< of this executable, where its siblings lie
  std::string search_path;          ///< PATH
  std::filesystem::path state;      ///< where a farm keeps its state by default; empty when there is no home
  std::filesystem::path temporary;  ///< TMPDIR or /tmp
  std::ostream& out;
  std::ostream& err;
  std::string server = {};  ///< PHOTONFARM_SERVER
  std::string token = {};   ///< PHOTONFARM_TOKEN
  bool terminal = false;    ///< standard error is one
  int columns = 80;         ///< of that
  /// When set, a command shows its parser to it and does nothing else; for shell completion.
  std::function<void(const CLI::App& parser)> inspect = {};
};

using Arguments = std::vector<std::string>;

/// One command of `photonfarm`: parses its own arguments, runs, returns the exit code.
struct Command {
  std::string_view name;
  std::string_view summary;  ///< one line of `photonfarm --help`
  std::string_view example;
  int (*run)(const Context& context, const Arguments& arguments);
};

[[nodiscard]] std::span<const Command> commands();

/// Finds the command and runs it. Usage errors are written to `context.err` and give 2.
[[nodiscard]] int run_photonfarm(const Context& context, const Arguments& arguments);

/// Parses a command's arguments. Empty: go on. Else the exit code: 0 after --help (written to `context.out`),
/// 2 after a usage error (written to `context.err`, with the nearest valid option).
[[nodiscard]] std::optional<int> parse_arguments(CLI::App& app, const Context& context, const Arguments& arguments);

[[nodiscard]] int run_render_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_plan_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_compare_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_bench_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_farm_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_doctor_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_submit_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_list_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_show_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_watch_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_logs_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_cancel_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_download_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_workers_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_pause_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_resume_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_retry_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_extend_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_set_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_remove_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_units_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_validate_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_completion_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_verify_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_estimate_command(const Context& context, const Arguments& arguments);
[[nodiscard]] int run_token_command(const Context& context, const Arguments& arguments);

}  // namespace pf
