// photonfarm-worker: parses, wires, exits; see worker/command_line.h.

#include <atomic>
#include <csignal>
#include <exception>
#include <iostream>
#include <string>
#include <vector>

#include <sys/ioctl.h>
#include <unistd.h>

#include "common/base/memory.h"
#include "common/base/result.h"
#include "worker/command_line.h"

namespace {

// A signal handler can reach nothing but this.
std::atomic<bool> interrupted{false};

void on_interrupt(int signal) {
  interrupted.store(true);
  std::signal(signal, SIG_DFL);  // a second one ends the process at once
}

int terminal_columns() {
  winsize size{};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

}  // namespace

int main(int argc, char** argv) {
  pf::keep_freed_memory();  // photons and their tree come and go with every sub-pass
  std::signal(SIGINT, on_interrupt);
  std::signal(SIGTERM, on_interrupt);
  std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is an error like a full disk
  try {
    const pf::WorkerContext context{std::cout, std::cerr, isatty(STDERR_FILENO) != 0, terminal_columns(), &interrupted};
    return pf::run_worker(context, std::vector<std::string>(argv + 1, argv + argc));
  } catch (const std::exception& error) {
    std::cerr << "photonfarm-worker: " << error.what() << '\n';
    return pf::exit_code(pf::ErrorKind::kInternal);
  }
}
