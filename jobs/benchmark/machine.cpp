#include "jobs/benchmark/machine.h"

#include <sched.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <thread>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "build_id.h"
#include "jobs/benchmark/worker_runner.h"

namespace pf::bench {
namespace {

using nlohmann::json;

/// What follows the colon of the first line that starts with `key`.
json field_of(const char* file, std::string_view key) {
  std::ifstream stream(file);
  for (std::string line; std::getline(stream, line);) {
    const std::size_t colon = line.find(':');
    if (!line.starts_with(key) || colon == std::string::npos) continue;
    const std::size_t begin = line.find_first_not_of(" \t", colon + 1);
    return begin == std::string::npos ? json() : json(line.substr(begin));
  }
  return {};
}

json first_line(const char* file) {
  std::ifstream stream(file);
  std::string line;
  return std::getline(stream, line) ? json(line) : json();
}

json cache_bytes(int name) {
  const long bytes = sysconf(name);
  return bytes > 0 ? json(bytes) : json();
}

}  // namespace

json describe_machine(const std::string& worker) {
  utsname system{};
  uname(&system);
  return {{"cpu", field_of("/proc/cpuinfo", "model name")},
          {"processors", std::thread::hardware_concurrency()},
          {"usable_processors", last_processors(CPU_SETSIZE).size()},
          {"mhz_at_start", field_of("/proc/cpuinfo", "cpu MHz")},
          {"governor", first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")},
          {"l2_bytes", cache_bytes(_SC_LEVEL2_CACHE_SIZE)},
          {"l3_bytes", cache_bytes(_SC_LEVEL3_CACHE_SIZE)},
          {"memory", field_of("/proc/meminfo", "MemTotal")},
          {"system", fmt::format("{} {}", system.sysname, system.release)},
          {"load_at_start", load_averages()},
          {"build_id", kBuildId},
          {"compiler", __VERSION__},
          {"worker_sha256", worker}};
}

json load_averages() {
  std::array<double, 3> loads{};
  return getloadavg(loads.data(), 3) == 3 ? json(loads) : json();
}

}  // namespace pf::bench
