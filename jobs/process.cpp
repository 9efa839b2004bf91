#include "jobs/process.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <sstream>
#include <system_error>

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fmt/format.h>

namespace pf {
namespace {

constexpr std::size_t kMaxCaptured = 65536;

/// argv for exec; borrows the strings.
std::vector<char*> make_argv(std::string& program, std::vector<std::string>& arguments) {
  std::vector<char*> argv = {program.data()};
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  return argv;
}

tl::unexpected<Error> cannot_start(const std::string& program, int error) {
  return fail(ErrorKind::kUnavailable,
              fmt::format("{}: cannot be started: {}", program, std::generic_category().message(error)));
}

ProcessEnd end_of(int status) {
  if (WIFSIGNALED(status)) return {0, WTERMSIG(status)};
  return {WEXITSTATUS(status), 0};
}

/// Blocks signals while alive.
class BlockedSignals {
 public:
  explicit BlockedSignals(std::initializer_list<int> signals) {
    sigemptyset(&blocked_);
    for (const int signal : signals) sigaddset(&blocked_, signal);
    pthread_sigmask(SIG_BLOCK, &blocked_, &before_);
  }
  ~BlockedSignals() { restore(); }
  BlockedSignals(const BlockedSignals&) = delete;
  BlockedSignals& operator=(const BlockedSignals&) = delete;

  void restore() const { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  [[nodiscard]] siginfo_t wait() const {
    siginfo_t info{};
    while (sigwaitinfo(&blocked_, &info) < 0) {
    }
    return info;
  }

 private:
  sigset_t blocked_{};
  sigset_t before_{};
};

/// In the child: becomes the program, or reports why not through `report`.
[[noreturn]] void become(char** argv, pid_t parent, const BlockedSignals& signals, int report) {
  signals.restore();
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() == parent) execv(argv[0], argv);  // else the parent died before prctl
  const int error = errno;
  [[maybe_unused]] const auto written = write(report, &error, sizeof error);
  _exit(127);
}

}  // namespace

Result<ProcessEnd> run_to_end(const std::filesystem::path& program, const std::vector<std::string>& arguments) {
  std::string name = program.string();
  std::vector<std::string> copies = arguments;
  std::vector<char*> argv = make_argv(name, copies);
  std::array<int, 2> report{};
  if (pipe2(report.data(), O_CLOEXEC) != 0) return cannot_start(name, errno);
  std::signal(SIGCHLD, SIG_DFL);  // a parent that ignores it would have the kernel reap our child
  const BlockedSignals signals({SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGCHLD});
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child == 0) become(argv.data(), parent, signals, report[1]);
  const int fork_error = errno;
  close(report[1]);
  int exec_error = 0;
  const bool exec_failed = child > 0 && read(report[0], &exec_error, sizeof exec_error) == sizeof exec_error;
  close(report[0]);
  if (child < 0) return cannot_start(name, fork_error);
  int status = 0;
  if (exec_failed) {
    waitpid(child, &status, 0);
    return cannot_start(name, exec_error);
  }
  while (waitpid(child, &status, WNOHANG) != child) {
    const siginfo_t info = signals.wait();
    // si_code above 0 is the kernel's: Ctrl-C at the terminal, which the child gets too.
    if (info.si_signo != SIGCHLD && info.si_code <= 0) kill(child, info.si_signo);
  }
  return end_of(status);
}

Result<CapturedProcess> run_and_capture(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                                        double seconds) {
  std::string name = program.string();
  std::vector<std::string> copies = arguments;
  std::vector<char*> argv = make_argv(name, copies);
  std::array<int, 2> output{};
  if (pipe2(output.data(), O_CLOEXEC) != 0) return cannot_start(name, errno);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, output[1], STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  pid_t child = 0;
  const int error = posix_spawn(&child, name.c_str(), &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(output[1]);
  if (error != 0) {
    close(output[0]);
    return cannot_start(name, error);
  }

  CapturedProcess captured;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  bool open = true, late = false;
  while (open && !late) {
    const std::chrono::duration<double, std::milli> left = deadline - std::chrono::steady_clock::now();
    pollfd ready{output[0], POLLIN, 0};
    const int polled = poll(&ready, 1, static_cast<int>(std::max(0.0, left.count())));
    late = polled == 0;
    if (polled <= 0) continue;
    std::array<char, 4096> buffer{};
    const ssize_t got = read(output[0], buffer.data(), buffer.size());
    open = got > 0 || (got < 0 && errno == EINTR);
    const std::size_t room = kMaxCaptured - captured.output.size();
    if (got > 0) captured.output.append(buffer.data(), std::min(room, static_cast<std::size_t>(got)));
  }
  close(output[0]);
  if (late) kill(child, SIGKILL);
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (late) return fail(ErrorKind::kTimeout, fmt::format("{}: no answer within {:g} s", name, seconds));
  captured.end = end_of(status);
  return captured;
}

std::filesystem::path find_program(const std::string& name, const std::string& search_path) {
  std::istringstream folders(search_path);
  std::string folder;
  while (std::getline(folders, folder, ':')) {
    std::filesystem::path candidate = std::filesystem::path(folder.empty() ? "." : folder) / name;
    std::error_code ignored;
    if (std::filesystem::is_regular_file(candidate, ignored) && access(candidate.c_str(), X_OK) == 0) return candidate;
  }
  return {};
}

}  // namespace pf
