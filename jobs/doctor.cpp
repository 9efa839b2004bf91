#include "jobs/doctor.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>

#include <sched.h>
#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "jobs/process.h"

namespace pf {
namespace {

constexpr std::uint64_t kMiB = 1024 * 1024;
constexpr double kWorkerSeconds = 10;

std::string size_words(std::uint64_t bytes) {
  const double mib = static_cast<double>(bytes) / static_cast<double>(kMiB);
  return mib < 10240.0 ? fmt::format("{:.0f} MiB", mib) : fmt::format("{:.0f} GiB", mib / 1024.0);
}

/// First number of a file that holds one; the largest value where it holds none ("max") or does not exist.
std::uint64_t number_in(const std::filesystem::path& file) {
  std::uint64_t value = 0;
  return std::ifstream(file) >> value ? value : ~std::uint64_t{0};
}

/// Memory that programs may still take: the system's estimate, or what the control group leaves if that is
/// less.
std::uint64_t available_memory() {
  std::uint64_t available = ~std::uint64_t{0};
  std::ifstream meminfo("/proc/meminfo");
  std::string key, unit;
  std::uint64_t kilobytes = 0;
  while (meminfo >> key >> kilobytes && std::getline(meminfo, unit)) {
    if (key == "MemAvailable:") available = kilobytes * 1024;
  }
  const std::uint64_t limit = number_in("/sys/fs/cgroup/memory.max");
  const std::uint64_t used = number_in("/sys/fs/cgroup/memory.current");
  if (limit != ~std::uint64_t{0} && used <= limit) available = std::min(available, limit - used);
  return available;
}

std::filesystem::path nearest_existing(std::filesystem::path folder) {
  std::error_code ignored;
  while (!std::filesystem::is_directory(folder, ignored) && folder != folder.parent_path()) {
    folder = folder.parent_path();
  }
  return folder;
}

}  // namespace

Check check_cpu() {
  const std::array<std::pair<const char*, bool>, 4> needed = {{{"AVX2", __builtin_cpu_supports("avx2") != 0},
                                                               {"FMA", __builtin_cpu_supports("fma") != 0},
                                                               {"BMI2", __builtin_cpu_supports("bmi2") != 0},
                                                               {"SSE4.2", __builtin_cpu_supports("sse4.2") != 0}}};
  std::vector<std::string> has, lacks;
  for (const auto& [name, present] : needed) (present ? has : lacks).emplace_back(name);
  if (lacks.empty()) return {"cpu", Health::kOk, fmt::format("{}", fmt::join(has, ", ")), ""};
  return {"cpu", Health::kBad, fmt::format("lacks {}", fmt::join(lacks, ", ")),
          "every x86-64 processor since 2013 (Intel) or 2015 (AMD) has them; in a virtual machine, choose "
          "the host's model"};
}

Check check_worker(const std::filesystem::path& program, const std::string& build_id) {
  const auto bad = [](std::string found, std::string hint) {
    return Check{"worker", Health::kBad, std::move(found), std::move(hint)};
  };
  std::error_code ignored;
  if (!std::filesystem::exists(program, ignored)) {
    return bad(fmt::format("{} does not exist", program.string()),
               "build or install photonfarm-worker beside photonfarm");
  }
  const Result<CapturedProcess> run = run_and_capture(program, {"--version"}, kWorkerSeconds);
  if (!run) return bad(run.error().message, "build or install photonfarm-worker again");
  if (run->end.signal != 0) {
    return bad(fmt::format("killed by signal {} ({})", run->end.signal, sigdescr_np(run->end.signal)),
               "build or install photonfarm-worker again");
  }
  if (run->end.exit_code != 0) {
    return bad(fmt::format("--version ended with exit code {}", run->end.exit_code),
               "a library may be missing: run deploy/install");
  }
  // `photonfarm-worker BUILD_ID`
  const std::string line = run->output.substr(0, run->output.find('\n'));
  const std::string answer = line.substr(line.rfind(' ') + 1);
  if (answer != build_id) {
    return bad(fmt::format("its build is {}, this is {}", answer, build_id), "build or install both together");
  }
  return {"worker", Health::kOk, answer, ""};
}

Check check_nats(const std::string& search_path) {
  const std::filesystem::path program = find_program("nats-server", search_path + ":/usr/sbin:/usr/local/sbin");
  if (!program.empty()) return {"nats-server", Health::kOk, program.string(), ""};
  return {"nats-server", Health::kNote, "not found in PATH", "only a farm needs it: apt-get install nats-server"};
}

Check check_writable(std::string name, const std::filesystem::path& folder) {
  if (folder.empty()) {
    return {std::move(name), Health::kBad, "no folder is known", "set HOME or XDG_STATE_HOME"};
  }
  const std::filesystem::path existing = nearest_existing(folder);
  std::string file = (existing / "photonfarm-doctor-XXXXXX").string();
  const int descriptor = mkstemp(file.data());
  int error = descriptor < 0 ? errno : 0;
  if (descriptor >= 0) {
    if (write(descriptor, "photonfarm", 10) != 10) error = errno != 0 ? errno : ENOSPC;
    close(descriptor);
    unlink(file.c_str());
  }
  if (error == 0) return {std::move(name), Health::kOk, fmt::format("{} is writable", folder.string()), ""};
  return {std::move(name), Health::kBad,
          fmt::format("{}: {}", existing.string(), std::generic_category().message(error)),
          "make the folder writable, or choose another"};
}

Check judge_disk(std::uint64_t free_bytes) {
  const std::string found = size_words(free_bytes) + " free";
  if (free_bytes < 100 * kMiB) return {"disk", Health::kBad, found, "images and checkpoints need at least 100 MiB"};
  if (free_bytes < 1024 * kMiB) return {"disk", Health::kNote, found, "a farm's results may need more than 1 GiB"};
  return {"disk", Health::kOk, found, ""};
}

Check judge_memory(std::uint64_t available_bytes) {
  if (available_bytes == ~std::uint64_t{0}) {
    return {"memory", Health::kNote, "the system does not say how much is available", ""};
  }
  const std::string found = size_words(available_bytes) + " available";
  if (available_bytes < 256 * kMiB) return {"memory", Health::kBad, found, "even small scenes need 256 MiB"};
  if (available_bytes < 1024 * kMiB)
    return {"memory", Health::kNote, found, "large scenes or images need more than 1 GiB"};
  return {"memory", Health::kOk, found, ""};
}

Check check_threads() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  const int threads = sched_getaffinity(0, sizeof allowed, &allowed) == 0 ? CPU_COUNT(&allowed) : 1;
  std::string found = fmt::format("{} may run at once", threads);
  // cgroup v2: "quota period" in microseconds, or "max period".
  std::uint64_t quota = 0, period = 0;
  std::ifstream limit("/sys/fs/cgroup/cpu.max");
  if (limit >> quota >> period && period > 0 && quota < period * static_cast<std::uint64_t>(threads)) {
    return {
        "threads", Health::kNote,
        fmt::format("{}, in {:.1f} processors' time", found, static_cast<double>(quota) / static_cast<double>(period)),
        "the control group limits this process: --threads with fewer threads loses nothing"};
  }
  return {"threads", Health::kOk, std::move(found), ""};
}

std::vector<Check> examine(const Machine& machine) {
  std::vector<Check> checks;
  checks.push_back(check_cpu());
  checks.push_back(check_worker(machine.folder / "photonfarm-worker", machine.build_id));
  checks.push_back(check_nats(machine.search_path));
  checks.push_back(check_writable("state folder", machine.state));
  checks.push_back(check_writable("temp folder", machine.temporary));
  std::error_code error;
  const auto space = std::filesystem::space(nearest_existing(machine.state.empty() ? "/" : machine.state), error);
  checks.push_back(judge_disk(error ? 0 : space.available));
  checks.push_back(judge_memory(available_memory()));
  checks.push_back(check_threads());
  return checks;
}

bool all_well(const std::vector<Check>& checks) {
  return std::none_of(checks.begin(), checks.end(), [](const Check& c) { return c.health == Health::kBad; });
}

std::string_view to_string(Health health) {
  switch (health) {
    case Health::kOk:
      return "ok";
    case Health::kNote:
      return "note";
    case Health::kBad:
      return "bad";
  }
  return "bad";
}

std::string doctor_text(const std::vector<Check>& checks, std::string_view well, std::string_view unwell) {
  std::string text;
  for (const Check& check : checks) {
    text += fmt::format("{:<6}{:<14} {}\n", to_string(check.health), check.name, check.found);
    if (!check.hint.empty()) text += fmt::format("{:<21}{}\n", "", check.hint);
  }
  text += all_well(checks) ? well : unwell;
  return text + '\n';
}

nlohmann::json doctor_json(const std::vector<Check>& checks, const std::string& build_id) {
  nlohmann::json list = nlohmann::json::array();
  for (const Check& check : checks) {
    list.push_back({{"name", check.name},
                    {"health", std::string(to_string(check.health))},
                    {"found", check.found},
                    {"hint", check.hint}});
  }
  return {{"ok", all_well(checks)}, {"build_id", build_id}, {"checks", std::move(list)}};
}

}  // namespace pf
