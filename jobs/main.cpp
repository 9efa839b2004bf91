// photonfarm: the command. Parses, wires, exits; see jobs/command.h.

#include <cstdlib>
#include <exception>
#include <filesystem>
#include <iostream>

#include <sys/ioctl.h>
#include <unistd.h>

#include "common/base/result.h"
#include "jobs/command.h"

namespace {

std::string environment(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): no thread has been started yet
  return value == nullptr ? std::string() : std::string(value);
}

/// $XDG_STATE_HOME/photonfarm, by default ~/.local/state/photonfarm (XDG Base Directory Specification 0.8).
std::filesystem::path state_folder() {
  const std::filesystem::path state = environment("XDG_STATE_HOME");
  if (state.is_absolute()) return state / "photonfarm";
  const std::filesystem::path home = environment("HOME");
  return home.empty() ? home : home / ".local" / "state" / "photonfarm";
}

int terminal_columns() {
  winsize size{};
  return ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const pf::Context context{std::filesystem::read_symlink("/proc/self/exe").parent_path(),
                              environment("PATH"),
                              state_folder(),
                              std::filesystem::temp_directory_path(),
                              std::cout,
                              std::cerr,
                              environment("PHOTONFARM_SERVER"),
                              environment("PHOTONFARM_TOKEN"),
                              ::isatty(STDERR_FILENO) != 0,
                              terminal_columns()};
    const int code = pf::run_photonfarm(context, pf::Arguments(argv + 1, argv + argc));
    std::cout.flush();
    if (!std::cout) {
      std::cerr << "photonfarm: standard output cannot be written\n";
      return pf::exit_code(pf::ErrorKind::kInternal);
    }
    return code;
  } catch (const std::exception& error) {
    std::cerr << "photonfarm: " << error.what() << '\n';
    return pf::exit_code(pf::ErrorKind::kInternal);
  }
}
