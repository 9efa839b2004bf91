#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "common/base/hash.h"
#include "common/base/result.h"
#include "common/wire/limits.h"

namespace pf {

// A chunk: one zstd frame that states the size of its content. The content:
//   4 bytes  magic, which says of what its tiles are
//   u32      number of tiles, 1 or more
//   then the tiles

/// Most bytes of a chunk's content; chosen so that even what does not compress fits kMaxChunkBytes.
inline constexpr std::size_t kMaxContentBytes = 990'000;
inline constexpr std::size_t kChunkHeaderBytes = 8;

/// XXH3-128 of bytes that come in pieces.
class ContentHash {
 public:
  ContentHash();
  ~ContentHash();
  ContentHash(ContentHash&&) noexcept;
  ContentHash& operator=(ContentHash&&) noexcept;
  void update(std::string_view bytes);
  [[nodiscard]] Hash128 digest() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Collects tiles into chunks.
class ChunkWriter {
 public:
  using Sink = std::function<Result<void>(std::string_view chunk)>;
  /// `magic`: 4 bytes.
  ChunkWriter(std::string_view magic, Sink sink);
  ~ChunkWriter();

  /// Where the next tile, of at most `most_bytes`, is to be appended; a full chunk goes to the sink first.
  [[nodiscard]] Result<std::string*> next_tile(std::size_t most_bytes);
  /// Sends what is left and returns the hash of all contents.
  [[nodiscard]] Result<Hash128> finish();

 private:
  [[nodiscard]] Result<void> flush();

  struct Compressor;
  std::string magic_;
  Sink sink_;
  std::string content_;
  std::uint32_t tiles_ = 0;
  ContentHash hash_;
  std::unique_ptr<Compressor> compressor_;
};

/// A chunk's content, and where in it the tiles stand.
struct ChunkContent {
  std::unique_ptr<char[]> bytes;
  std::size_t size = 0;
  std::uint32_t tiles = 0;
  [[nodiscard]] std::string_view all() const { return {bytes.get(), size}; }
  [[nodiscard]] std::string_view body() const { return all().substr(kChunkHeaderBytes); }
};

/// Decompresses a chunk. `most_tile_bytes` and `most_tiles` bound what is allocated. Errors: kInvalidInput.
[[nodiscard]] Result<ChunkContent> open_chunk(std::string_view chunk, std::string_view magic,
                                              std::size_t most_tile_bytes, std::size_t most_tiles);

}  // namespace pf
