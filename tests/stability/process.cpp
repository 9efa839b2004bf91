#include "tests/stability/process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/inotify.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <stdexcept>
#include <system_error>

namespace pf::test {
namespace {

[[noreturn]] void throw_errno(const char* what) { throw std::system_error(errno, std::generic_category(), what); }

int milliseconds(double seconds) { return static_cast<int>(seconds * 1000.0); }

/// In the child, between fork and exec: system calls only.
[[noreturn]] void become(char* const* argv, const char* out, const char* err, std::uint64_t max_file_bytes) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // a test that is killed takes its child along
  const int out_fd = ::open(out, O_WRONLY | O_CREAT | O_TRUNC, 0600);
  const int err_fd = ::open(err, O_WRONLY | O_CREAT | O_TRUNC, 0600);
  ::dup2(out_fd, STDOUT_FILENO);
  ::dup2(err_fd, STDERR_FILENO);
  if (max_file_bytes > 0) {
    const ::rlimit limit{max_file_bytes, max_file_bytes};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    ::signal(SIGXFSZ, SIG_IGN);  // write() then fails with EFBIG, as it does with ENOSPC on a full disk
  }
  ::execv(argv[0], argv);
  ::_exit(127);
}

}  // namespace

std::ostream& operator<<(std::ostream& out, const ProcessEnd& end) {
  return end.signal != 0 ? out << "killed by signal " << end.signal : out << "exit code " << end.code;
}

Process::Process(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                 const std::filesystem::path& folder, std::uint64_t max_file_bytes)
    : stdout_(folder / ".stdout"), stderr_(folder / ".stderr") {
  std::string name = program.string();
  std::vector<std::string> copies = arguments;
  std::vector<char*> argv{name.data()};
  for (std::string& argument : copies) argv.push_back(argument.data());
  argv.push_back(nullptr);
  pid_ = ::fork();
  if (pid_ < 0) throw_errno("fork");
  if (pid_ == 0) become(argv.data(), stdout_.c_str(), stderr_.c_str(), max_file_bytes);
  pidfd_ = static_cast<int>(::syscall(SYS_pidfd_open, pid_, 0));
  if (pidfd_ < 0) throw_errno("pidfd_open");
}

Process::~Process() {
  if (!ended_) {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  ::close(pidfd_);
}

void Process::collect() {
  int status = 0;
  if (::waitpid(pid_, &status, 0) != pid_) throw_errno("waitpid");
  ended_ = true;
  end_ = WIFSIGNALED(status) ? ProcessEnd::killed(WTERMSIG(status)) : ProcessEnd::exited(WEXITSTATUS(status));
}

bool Process::running() {
  if (!ended_) {
    ::pollfd end{pidfd_, POLLIN, 0};
    if (::poll(&end, 1, 0) > 0) collect();
  }
  return !ended_;
}

void Process::signal(int number) {
  if (!ended_) ::kill(pid_, number);
}

ProcessEnd Process::wait(double seconds) {
  if (ended_) return end_;
  ::pollfd end{pidfd_, POLLIN, 0};
  const bool late = ::poll(&end, 1, milliseconds(seconds)) <= 0;
  if (late) ::kill(pid_, SIGKILL);
  collect();
  if (late) end_ = ProcessEnd::killed(SIGABRT);
  return end_;
}

FolderWatch::FolderWatch(const std::filesystem::path& folder)
    : fd_(::inotify_init1(IN_CLOEXEC | IN_NONBLOCK)), buffer_(1 << 16) {
  if (fd_ < 0) throw_errno("inotify_init1");
  if (::inotify_add_watch(fd_, folder.c_str(), IN_CREATE | IN_MOVED_TO) < 0) throw_errno("inotify_add_watch");
}

FolderWatch::~FolderWatch() { ::close(fd_); }

bool FolderWatch::wait_for_any(const Process& process, double seconds) {
  if (begin_ == end_) {
    std::vector<::pollfd> sources{{fd_, POLLIN, 0}, {process.descriptor(), POLLIN, 0}};
    if (::poll(sources.data(), sources.size(), milliseconds(seconds)) <= 0 || sources[0].revents == 0) return false;
    const ssize_t got = ::read(fd_, buffer_.data(), buffer_.size());
    if (got <= 0) return false;
    begin_ = 0;
    end_ = static_cast<std::size_t>(got);
  }
  const auto* event = reinterpret_cast<const ::inotify_event*>(buffer_.data() + begin_);
  begin_ += sizeof(::inotify_event) + event->len;
  return true;
}

}  // namespace pf::test
