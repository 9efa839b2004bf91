#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "common/base/result.h"
#include "coordinator/layer_pixels.h"

namespace pf {

/// Images for screens, each made once for all that look at it: fifty watchers cost little more than one.
/// Called from many threads.
class PixelCache {
 public:
  using Pixels = std::shared_ptr<const LayerPixels>;
  using Make = std::function<Result<LayerPixels>()>;

  explicit PixelCache(std::uint64_t max_bytes) : max_bytes_(max_bytes) {}

  /// What `make` gave for `key` while `state` was the same. `may_lag`: also a former state's while making
  /// images would take more than a twenty-fifth of the time; the caller sees from its passes that there is a
  /// newer one to come.
  [[nodiscard]] Result<Pixels> get(const std::string& key, const std::string& state, bool may_lag, const Make& make);

 private:
  using Instant = std::chrono::steady_clock::time_point;
  struct Entry {
    std::string key;
    std::mutex making;  ///< the members below
    std::string state;
    Pixels pixels;
    Instant next;             ///< not made again before
    std::uint64_t bytes = 0;  ///< guarded by the cache's mutex
  };
  [[nodiscard]] std::shared_ptr<Entry> used(const std::string& key);
  void count(const std::shared_ptr<Entry>& entry, std::uint64_t bytes);

  const std::uint64_t max_bytes_;
  std::mutex mutex_;
  std::list<std::shared_ptr<Entry>> entries_;  ///< the latest used first; few
};

}  // namespace pf
