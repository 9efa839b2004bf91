#include "jobs/benchmark/worker_runner.h"

#include <sched.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <ctime>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/base/atomic_file.h"
#include "jobs/child.h"
#include "jobs/process.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;
using std::chrono::steady_clock;

constexpr std::uint64_t kMaxTextBytes = std::uint64_t{1} << 24;  // of logs and figures
constexpr double kPlanSeconds = 600;
constexpr auto kTick = std::chrono::milliseconds(100);

/// The last line of a log that says something.
std::string last_line(const fs::path& log) {
  const auto text = read_file(log, kMaxTextBytes);
  if (!text) return "";
  const std::size_t end = text->find_last_not_of("\r\n ");
  if (end == std::string::npos) return "";
  const std::size_t begin = text->find_last_of("\r\n", end);
  return text->substr(begin == std::string::npos ? 0 : begin + 1,
                      end - (begin == std::string::npos ? 0 : begin + 1) + 1);
}

std::vector<std::string> arguments_of(const RenderOrder& order) {
  std::vector<std::string> arguments = {"render",           order.job.string(), "--out",
                                        order.out.string(), "--threads",        std::to_string(order.threads)};
  for (const std::string& set : order.set) arguments.insert(arguments.end(), {"--set", set});
  if (order.processor_time) arguments.emplace_back("--processor-time");
  if (order.resume) arguments.emplace_back("--resume");
  if (!order.snapshot_seconds.empty()) {
    arguments.insert(arguments.end(),
                     {"--snapshot-seconds", fmt::format("{}", fmt::join(order.snapshot_seconds, ","))});
  }
  if (!order.snapshot_passes.empty()) {
    arguments.insert(arguments.end(), {"--snapshot-passes", fmt::format("{}", fmt::join(order.snapshot_passes, ","))});
  }
  return arguments;
}

/// Seconds that count against a render's timeout. Of processor time where budgets are: on a machine that does other
/// work a render may wait for long without being slow; one that only waits is ended, too, after so many times the
/// timeout.
double spent(const Child& child, const RenderOrder& order, double wall_seconds) {
  constexpr double kMostWaiting = 20;
  clockid_t clock{};
  timespec now{};
  if (!order.processor_time || clock_getcpuclockid(child.pid(), &clock) != 0 || clock_gettime(clock, &now) != 0) {
    return wall_seconds;
  }
  const double processor = static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  return std::max(processor, wall_seconds / kMostWaiting);
}

}  // namespace

std::vector<int> last_processors(int threads) {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cpus;
  if (sched_getaffinity(0, sizeof set, &set) != 0) return cpus;
  for (int cpu = CPU_SETSIZE - 1; cpu >= 0 && static_cast<int>(cpus.size()) < threads; --cpu) {
    if (CPU_ISSET(cpu, &set)) cpus.push_back(cpu);
  }
  return cpus;
}

Result<RenderOutcome> WorkerRunner::render(const RenderOrder& order, const std::function<void(double)>& tick) {
  const fs::path log = order.out / "log";
  const auto start = steady_clock::now();
  auto child = Child::start({worker_, arguments_of(order), log, last_processors(order.threads)});
  if (!child) return tl::unexpected(child.error());
  RenderOutcome outcome;
  std::optional<ProcessEnd> end;
  while (!end) {
    end = child->wait(steady_clock::now() + kTick);
    outcome.wall_seconds = std::chrono::duration<double>(steady_clock::now() - start).count();
    tick(outcome.wall_seconds);
    if (interrupted_.load()) return fail(ErrorKind::kInterrupted, "interrupted");  // the child goes with its handle
    if (!end && order.timeout > 0 && spent(*child, order, outcome.wall_seconds) > order.timeout) {
      outcome.error = fmt::format("took longer than {:g} s and was ended", order.timeout);
      return outcome;
    }
  }
  if (end->exit_code != 0 || end->signal != 0) {
    outcome.error = fmt::format("{}: {}", to_string(*end), last_line(log));
    return outcome;
  }
  const auto text = read_file(order.out / fmt::format("{}.json", kImageName), kMaxTextBytes);
  outcome.figures = text ? nlohmann::json::parse(*text, nullptr, false) : nlohmann::json();
  if (!outcome.figures.is_object()) outcome.error = "left no figures";
  return outcome;
}

Result<nlohmann::json> WorkerRunner::plan(const fs::path& job, const std::vector<std::string>& set) {
  std::vector<std::string> arguments = {"plan", job.string(), "--json"};
  for (const std::string& s : set) arguments.insert(arguments.end(), {"--set", s});
  const auto planned = run_and_capture(worker_, arguments, kPlanSeconds);
  if (!planned) return tl::unexpected(planned.error());
  nlohmann::json document = nlohmann::json::parse(planned->output, nullptr, false);
  if (planned->end.exit_code != 0 || planned->end.signal != 0 || !document.is_object()) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: cannot be planned: {}", job.string(), to_string(planned->end)));
  }
  return document;
}

}  // namespace pf::bench
