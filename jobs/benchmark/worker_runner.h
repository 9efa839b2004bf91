#pragma once

#include <atomic>
#include <filesystem>
#include <vector>

#include "jobs/benchmark/runner.h"

namespace pf::bench {

/// Runs photonfarm-worker, bound to the last processors that this process may use. One render at a time.
class WorkerRunner final : public Runner {
 public:
  WorkerRunner(std::filesystem::path worker, const std::atomic<bool>& interrupted)
      : worker_(std::move(worker)), interrupted_(interrupted) {}
  [[nodiscard]] Result<RenderOutcome> render(const RenderOrder& order,
                                             const std::function<void(double)>& tick) override;
  [[nodiscard]] Result<nlohmann::json> plan(const std::filesystem::path& job,
                                            const std::vector<std::string>& set) override;

 private:
  std::filesystem::path worker_;
  const std::atomic<bool>& interrupted_;
};

/// The last `threads` processors of those that this process may run on; fewer where there are not so many.
[[nodiscard]] std::vector<int> last_processors(int threads);

}  // namespace pf::bench
