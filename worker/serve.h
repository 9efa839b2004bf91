#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>

#include "common/base/log.h"
#include "common/base/result.h"
#include "common/wire/nats/engine.h"

namespace pf {

struct ServeOptions {
  EngineOptions engine;
  int threads = 0;  ///< 0: all of the machine
  std::filesystem::path cache;
  std::uint64_t cache_bytes = std::uint64_t{8} << 30;
  const std::atomic<bool>* interrupted = nullptr;  ///< drain: hand in what is there, then end
};

/// Serves a farm until interrupted or refused. Errors: kUnavailable when the engine cannot be reached at the start,
/// kUsage when the coordinator does not want this worker, kInternal for the cache folder.
[[nodiscard]] Result<void> serve_farm(const ServeOptions& options, const Log& log);

}  // namespace pf
