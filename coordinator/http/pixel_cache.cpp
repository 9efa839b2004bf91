#include "coordinator/http/pixel_cache.h"

#include <algorithm>

namespace pf {
namespace {

/// Of the time that an image took to make, before it is made again: 1 % of a core goes into each image at
/// most, however many watch.
constexpr int kPause = 99;
constexpr std::size_t kMaxEntries = 64;

}  // namespace

std::shared_ptr<PixelCache::Entry> PixelCache::used(const std::string& key) {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find_if(entries_, [&](const auto& e) { return e->key == key; });
  if (found != entries_.end()) {
    entries_.splice(entries_.begin(), entries_, found);
  } else {
    entries_.push_front(std::make_shared<Entry>());
    entries_.front()->key = key;
    if (entries_.size() > kMaxEntries) entries_.pop_back();
  }
  return entries_.front();
}

void PixelCache::count(const std::shared_ptr<Entry>& entry, std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  entry->bytes = bytes;
  std::uint64_t sum = 0;
  for (const auto& e : entries_) sum += e->bytes;
  while (sum > max_bytes_ && entries_.size() > 1) {
    sum -= entries_.back()->bytes;
    entries_.pop_back();
  }
}

Result<PixelCache::Pixels> PixelCache::get(const std::string& key, const std::string& state, bool may_lag,
                                           const Make& make) {
  const std::shared_ptr<Entry> entry = used(key);
  const std::lock_guard lock(entry->making);
  const Instant begin = std::chrono::steady_clock::now();
  if (entry->pixels && (entry->state == state || (may_lag && begin < entry->next))) return entry->pixels;
  auto made = make();
  if (!made) return tl::unexpected(made.error());
  const Instant end = std::chrono::steady_clock::now();
  entry->next = end + kPause * (end - begin);
  entry->state = state;
  entry->pixels = std::make_shared<const LayerPixels>(std::move(*made));
  count(entry, entry->pixels->rgb.size() * sizeof(std::uint16_t));
  return entry->pixels;
}

}  // namespace pf
