#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/hash.h"
#include "common/base/result.h"
#include "common/film/progressive.h"
#include "common/film/statistics.h"

namespace pf {

/// Pixels of a tile: consecutive ones, row by row; the unit of packing. A tile whose sums are all zero is
/// left out.
inline constexpr std::size_t kTilePixels = 4096;

/// Most chunks that an image's sums or radii can take: every chunk holds a tile at least.
[[nodiscard]] constexpr std::size_t most_chunks(std::uint64_t pixels) {
  return static_cast<std::size_t>((pixels + kTilePixels - 1) / kTilePixels);
}

/// A result on its way: zstd chunks of at most kMaxChunkBytes, each of whole tiles, and the XXH3-128 of all
/// chunks' contents before compression, one after the other.
struct PackedStatistics {
  std::vector<std::string> chunks;
  Hash128 content;
  std::size_t raw_bytes = 0;  ///< of the sums in memory
};
/// Pixel and feature sums; the figures (sub-passes, rays, ...) travel in the manifest.
[[nodiscard]] PackedStatistics pack_statistics(const Statistics& statistics);

/// Adds packed chunks to sums as they come. Exact integers can be taken off again: a result that turns out to
/// be wrong at its last chunk leaves no trace.
class StatisticsUnpacker {
 public:
  /// `into` outlives this. Its features may be empty: they come with the first chunk that holds some.
  explicit StatisticsUnpacker(Statistics& into);
  ~StatisticsUnpacker();
  StatisticsUnpacker(StatisticsUnpacker&&) noexcept;
  /// Adds one chunk. Errors: kInvalidInput for a malformed one (tile out of range, out of order or twice,
  /// sizes that disagree, a decompressed size beyond what its tiles can hold: nothing is allocated before
  /// that check) and kInternal for a sum that overflows; then nothing of this chunk has been added.
  [[nodiscard]] Result<void> add(std::string_view chunk);
  /// Takes off a chunk that was added, by this object or another one. Wholly or not at all; errors as above,
  /// kInternal also where the sums show that it cannot have been added. content() goes on counting it.
  [[nodiscard]] Result<void> take_off(std::string_view chunk);
  /// Hash of what was added so far.
  [[nodiscard]] Hash128 content() const;

 private:
  struct State;
  Statistics& into_;
  std::unique_ptr<State> state_;
};

/// Radii that a round's units need (radius2 of both flows, covered_radius), in the same kind of chunks;
/// `sink` takes them one after the other, so that nothing of the image's size is held. Returns the hash as
/// above.
[[nodiscard]] Result<Hash128> pack_state(const std::vector<ProgressivePixel>& state,
                                         const std::function<Result<void>(std::string_view chunk)>& sink);
class StateUnpacker {
 public:
  /// `into` has the image's size and outlives this. Members beside the radii stay as they are.
  explicit StateUnpacker(std::vector<ProgressivePixel>& into);
  ~StateUnpacker();
  StateUnpacker(StateUnpacker&&) noexcept;
  /// Errors: kInvalidInput; also for a radius that is negative or not finite. Then nothing of this chunk has
  /// been taken over.
  [[nodiscard]] Result<void> add(std::string_view chunk);
  /// True when every pixel has come exactly once.
  [[nodiscard]] bool complete() const;
  [[nodiscard]] Hash128 content() const;

 private:
  struct State;
  std::vector<ProgressivePixel>& into_;
  std::unique_ptr<State> state_;
};

}  // namespace pf
