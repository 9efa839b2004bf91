#include "jobs/child.h"

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstring>
#include <system_error>
#include <utility>

#include <fmt/format.h>

namespace pf {
namespace {

using std::chrono::steady_clock;

/// Between fork and exec: nothing here may allocate, for another thread may have held the allocator's lock.
[[noreturn]] void become(char** argv, pid_t parent, int input, int output, int report, const cpu_set_t& cpus) {
  sigset_t none;
  sigemptyset(&none);
  pthread_sigmask(SIG_SETMASK, &none, nullptr);
  setpgid(0, 0);
  if (CPU_COUNT(&cpus) > 0) sched_setaffinity(0, sizeof cpus, &cpus);
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  dup2(input, STDIN_FILENO);
  dup2(output, STDOUT_FILENO);
  dup2(output, STDERR_FILENO);
  if (getppid() == parent) execv(argv[0], argv);  // else the parent died before prctl
  const int error = errno;
  [[maybe_unused]] const auto written = write(report, &error, sizeof error);
  _exit(127);
}

/// Closes when it goes.
struct File {
  explicit File(int descriptor) : fd(descriptor) {}
  ~File() {
    if (fd >= 0) close(fd);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int fd;
};

tl::unexpected<Error> cannot_start(const std::filesystem::path& program, int error) {
  return fail(ErrorKind::kUnavailable,
              fmt::format("{}: cannot be started: {}", program.string(), std::generic_category().message(error)));
}

}  // namespace

bool wait_readable(int fd, steady_clock::time_point deadline) {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - steady_clock::now()).count();
    pollfd ready{fd, POLLIN, 0};
    const int polled = poll(&ready, 1, static_cast<int>(std::clamp<long long>(left, 0, INT_MAX)));
    if (polled > 0) return true;
    if (polled == 0 && left <= INT_MAX) return false;
  }
}

Result<Child> Child::start(const ChildOptions& options) {
  std::string program = options.program.string();
  std::vector<std::string> arguments = options.arguments;
  std::vector<char*> argv = {program.data()};
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);

  const File input(open("/dev/null", O_RDONLY | O_CLOEXEC));
  const bool logged = !options.log.empty();
  const File output(logged ? open(options.log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600)
                           : open("/dev/null", O_WRONLY | O_CLOEXEC));
  if (output.fd < 0) return cannot_start(logged ? options.log : options.program, errno);
  std::array<int, 2> report{};
  if (pipe2(report.data(), O_CLOEXEC) != 0) return cannot_start(options.program, errno);
  const File report_in(report[0]);
  cpu_set_t cpus;
  CPU_ZERO(&cpus);
  for (const int cpu : options.cpus) CPU_SET(cpu, &cpus);
  const pid_t parent = getpid();
  const pid_t pid = fork();
  if (pid == 0) become(argv.data(), parent, input.fd, output.fd, report[1], cpus);
  const int fork_error = errno;
  close(report[1]);
  if (pid < 0) return cannot_start(options.program, fork_error);
  setpgid(pid, pid);  // whoever comes first: the child does it, too

  int exec_error = 0;
  ssize_t got = 0;
  do {
    got = read(report_in.fd, &exec_error, sizeof exec_error);
  } while (got < 0 && errno == EINTR);
  // Not glibc's own function: its header in 2.36 does not know C++.
  const int pidfd = static_cast<int>(syscall(SYS_pidfd_open, pid, 0));
  if (got == sizeof exec_error || pidfd < 0) {
    const int error = pidfd < 0 ? errno : exec_error;
    if (pidfd >= 0) close(pidfd);
    kill(pid, SIGKILL);
    while (waitpid(pid, nullptr, 0) < 0 && errno == EINTR) {
    }
    return cannot_start(options.program, error);
  }
  fcntl(pidfd, F_SETFD, FD_CLOEXEC);
  return Child(pid, pidfd);
}

Child::Child(Child&& other) noexcept
    : pid_(std::exchange(other.pid_, 0)), pidfd_(std::exchange(other.pidfd_, -1)), end_(other.end_) {}

Child& Child::operator=(Child&& other) noexcept {
  if (this == &other) return *this;
  destroy();
  pid_ = std::exchange(other.pid_, 0);
  pidfd_ = std::exchange(other.pidfd_, -1);
  end_ = other.end_;
  return *this;
}

Child::~Child() { destroy(); }

void Child::destroy() {
  if (pid_ == 0) return;
  if (!end()) {
    signal(SIGKILL);
    wait_readable(pidfd_, steady_clock::time_point::max());
    [[maybe_unused]] const auto reaped = end();
  }
  close(pidfd_);
  pid_ = 0;
}

void Child::signal(int number) const {
  if (pid_ > 0 && !end_) kill(-pid_, number);
}

std::optional<ProcessEnd> Child::end() {
  int status = 0;
  if (pid_ == 0 || end_ || waitpid(pid_, &status, WNOHANG) != pid_) return end_;
  end_ = WIFSIGNALED(status) ? ProcessEnd{0, WTERMSIG(status)} : ProcessEnd{WEXITSTATUS(status), 0};
  return end_;
}

std::optional<ProcessEnd> Child::wait(steady_clock::time_point deadline) {
  if (!end_) wait_readable(pidfd_, deadline);
  return end();
}

std::string to_string(const ProcessEnd& end) {
  if (end.signal == 0) return fmt::format("exited with code {}", end.exit_code);
  const char* name = sigabbrev_np(end.signal);
  return fmt::format("was killed by signal {} ({})", end.signal, name == nullptr ? "?" : name);
}

}  // namespace pf
