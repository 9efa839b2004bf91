// Compiled for any x86-64 (jobs/CMakeLists.txt): everything else would die of an illegal instruction before
// it could say what is missing. Runs before other static initialisers; uses nothing that could be built for a
// newer processor.

#include <unistd.h>

namespace {

[[gnu::constructor(101)]] void require_cpu() {
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2")) return;
  static constexpr char kMessage[] =
      "photonfarm: this processor lacks AVX2, FMA or BMI2; expected x86-64-v3 (Intel since 2013, AMD since "
      "2015); in a "
      "virtual machine, choose the host's model\n";
  [[maybe_unused]] const auto written = write(STDERR_FILENO, kMessage, sizeof kMessage - 1);
  _exit(5);
}

}  // namespace
