#pragma once

#include <atomic>
#include <iosfwd>
#include <string>
#include <vector>

namespace pf {

/// What main() hands to the commands.
struct WorkerContext {
  std::ostream& out;
  std::ostream& err;
  bool terminal = false;  ///< standard error is one: progress is a bar
  int columns = 80;
  const std::atomic<bool>* interrupted = nullptr;
};

/// `photonfarm-worker render|plan ...`; the exit code of the contract.
[[nodiscard]] int run_worker(const WorkerContext& context, const std::vector<std::string>& arguments);

}  // namespace pf
