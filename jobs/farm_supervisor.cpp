#include "jobs/farm_supervisor.h"

#include <poll.h>
#include <sys/inotify.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstddef>
#include <set>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>

namespace pf {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

constexpr auto kFirstWait = 250ms;
constexpr int kDoublings = 7;  // 250 ms * 2^7: 32 s
constexpr auto kProven = 3s;   // what ran so long did not fail at its start

/// Exit codes after which another try cannot help: usage, job file or another build; scene or image.
bool is_final(const ProcessEnd& end) { return end.signal == 0 && (end.exit_code == 2 || end.exit_code == 3); }

tl::unexpected<Error> system_failure(std::string_view what) {
  return fail(ErrorKind::kInternal, fmt::format("{}: {}", what, std::generic_category().message(errno)));
}

}  // namespace

std::chrono::milliseconds RestartPause::after(steady_clock::duration ran) {
  failures_ = ran >= kProven ? 1 : failures_ + 1;
  return kFirstWait * (1 << std::min(failures_ - 1, kDoublings));
}

Supervisor::Supervisor(Options options) : options_(std::move(options)) {
  for (Service& service : options_.services) all_.push_back({std::move(service), {}, {}, {}, {}, false});
}

Supervisor::~Supervisor() {
  if (signals_fd_ >= 0) close(signals_fd_);
  if (changes_fd_ >= 0) close(changes_fd_);
}

Result<void> Supervisor::listen() {
  sigset_t set;
  sigemptyset(&set);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    std::signal(signal, SIG_DFL);  // a shell's `&` has them ignored, and what is ignored never arrives
    sigaddset(&set, signal);
  }
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  signals_fd_ = signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
  if (signals_fd_ < 0) return system_failure("signals");
  changes_fd_ = inotify_init1(IN_CLOEXEC | IN_NONBLOCK);
  if (changes_fd_ < 0 || inotify_add_watch(changes_fd_, options_.watched.parent_path().c_str(), IN_MOVED_TO) < 0)
    return system_failure(options_.watched.parent_path().string());
  return {};
}

Result<void> Supervisor::run() {
  if (Result<void> ready = listen(); !ready) return ready;
  Result<void> well;
  for (Running& running : all_) {
    take_signals();
    if (well && signals_ == 0) well = start(running);
  }
  while (well && signals_ == 0) {
    std::optional<Time> next;
    for (const Running& running : all_) {
      if (running.start_at && (!next || *running.start_at < *next)) next = running.start_at;
    }
    wait(next);
    well = look_after_all();
  }
  stop_all();
  return well;
}

Result<void> Supervisor::start(Running& running) {
  running.start_at.reset();
  running.started = steady_clock::now();
  Result<Child> child = running.service.start();
  if (!child) return tl::unexpected(child.error());
  running.child = std::move(*child);
  return {};
}

Result<void> Supervisor::look_after_all() {
  for (Running& running : all_) {
    if (running.child) {
      const std::optional<ProcessEnd> end = running.child->end();
      if (!end) continue;
      running.child.reset();
      if (Result<void> taken = take_end(running, *end); !taken) return taken;
    } else if (running.start_at && steady_clock::now() >= *running.start_at) {
      if (const Result<void> started = start(running); !started) {
        // It did start once: the machine is short of something just now.
        options_.say(fmt::format("{}: {}", running.service.name, started.error().message));
        if (Result<void> taken = take_end(running, {exit_code(ErrorKind::kUnavailable), 0}); !taken) return taken;
      }
    }
  }
  return {};
}

Result<void> Supervisor::take_end(Running& running, const ProcessEnd& end) {
  const Service& service = running.service;
  if (is_final(end)) {
    running.given_up = true;
    const std::string text = fmt::format("{} {} and is not started again; see its log", service.name, to_string(end));
    if (service.needed || stage_is_lost(service.stop_stage))
      return fail(end.exit_code == 2 ? ErrorKind::kUsage : ErrorKind::kInvalidInput, text);
    options_.say(text);
    return {};
  }
  const auto now = steady_clock::now();
  const auto pause = running.pause.after(now - running.started);
  running.start_at = now + pause;
  options_.say(fmt::format("{} {}; starting it again in {:.2g} s", service.name, to_string(end),
                           std::chrono::duration<double>(pause).count()));
  return {};
}

/// All services of this stage have been given up.
bool Supervisor::stage_is_lost(int stage) const {
  return std::none_of(all_.begin(), all_.end(), [stage](const Running& running) {
    return running.service.stop_stage == stage && !running.given_up;
  });
}

/// Until something happens, at most until then.
void Supervisor::wait(std::optional<Time> until) {
  std::vector<pollfd> watched = {{signals_fd_, POLLIN, 0}, {changes_fd_, POLLIN, 0}};
  for (const Running& running : all_) {
    if (running.child) watched.push_back({running.child->pidfd(), POLLIN, 0});
  }
  int milliseconds = -1;
  if (until) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(*until - steady_clock::now()).count();
    milliseconds = static_cast<int>(std::clamp<long long>(left, 0, INT_MAX));
  }
  poll(watched.data(), watched.size(), milliseconds);
  take_signals();
  take_changes();
}

void Supervisor::take_signals() {
  signalfd_siginfo info{};
  while (read(signals_fd_, &info, sizeof info) == sizeof info) signals_ += 1;
}

void Supervisor::take_changes() {
  alignas(inotify_event) std::array<char, 4096> buffer{};
  const std::string name = options_.watched.filename().string();
  bool appeared = false;
  for (;;) {
    const ssize_t got = read(changes_fd_, buffer.data(), buffer.size());
    if (got <= 0) break;
    for (std::size_t at = 0; at < static_cast<std::size_t>(got);) {
      const auto* event = reinterpret_cast<const inotify_event*>(buffer.data() + at);
      appeared = appeared || (event->len > 0 && name == event->name);
      at += sizeof(inotify_event) + event->len;
    }
  }
  if (appeared) options_.appeared();
}

void Supervisor::stop_all() {
  std::set<int> stages;
  for (const Running& running : all_) stages.insert(running.service.stop_stage);
  for (const int stage : stages) stop_stage(stage);
}

void Supervisor::stop_stage(int stage) {
  const auto now = steady_clock::now();
  const auto killed_at = [now](const Service& service) {
    return now +
           std::chrono::duration_cast<steady_clock::duration>(std::chrono::duration<double>(service.stop_seconds));
  };
  std::vector<Running*> left;
  for (Running& running : all_) {
    if (running.service.stop_stage != stage || !running.child) continue;
    running.child->signal(SIGTERM);
    running.child->signal(SIGCONT);  // a stopped process would not see it
    left.push_back(&running);
  }
  while (!left.empty()) {
    const bool impatient = signals_ > 1;
    Time deadline = Time::max();
    std::erase_if(left, [&](Running* running) {
      if (running->child && (impatient || steady_clock::now() >= killed_at(running->service))) {
        options_.say(fmt::format("{} is killed", running->service.name));
        running->child.reset();
        return true;
      }
      if (!running->child || running->child->end()) {
        running->child.reset();
        return true;
      }
      deadline = std::min(deadline, killed_at(running->service));
      return false;
    });
    for (Running& running : all_) {
      if (running.child && running.child->end()) running.child.reset();  // of another stage: nobody waits for it
    }
    if (!left.empty()) wait(deadline);
  }
}

}  // namespace pf
