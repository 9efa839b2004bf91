#include "common/wire/chunk.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include <fmt/format.h>
#include <xxhash.h>
#include <zstd.h>

namespace pf {
namespace {

/// What differences leave is mostly noise, in which searching harder finds nothing: level 1 takes 1.4 times
/// the time for the same size within 1.5 % (tests/bench/wire_bench.cpp).
constexpr int kLevel = -1;
static_assert(ZSTD_COMPRESSBOUND(kMaxContentBytes) <= kMaxChunkBytes);

tl::unexpected<Error> refuse(std::string_view why) {
  return fail(ErrorKind::kInvalidInput, fmt::format("chunk refused: {}", why));
}

}  // namespace

struct ContentHash::State {
  std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> xxh{XXH3_createState(), &XXH3_freeState};
};

ContentHash::ContentHash() : state_(std::make_unique<State>()) { XXH3_128bits_reset(state_->xxh.get()); }
ContentHash::~ContentHash() = default;
ContentHash::ContentHash(ContentHash&&) noexcept = default;
ContentHash& ContentHash::operator=(ContentHash&&) noexcept = default;

void ContentHash::update(std::string_view bytes) { XXH3_128bits_update(state_->xxh.get(), bytes.data(), bytes.size()); }

Hash128 ContentHash::digest() const {
  const XXH128_hash_t hash = XXH3_128bits_digest(state_->xxh.get());
  return {hash.low64, hash.high64};
}

struct ChunkWriter::Compressor {
  std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> zstd{ZSTD_createCCtx(), &ZSTD_freeCCtx};
  std::string chunk = std::string(ZSTD_compressBound(kMaxContentBytes), '\0');
};

ChunkWriter::ChunkWriter(std::string_view magic, Sink sink)
    : magic_(magic), sink_(std::move(sink)), compressor_(std::make_unique<Compressor>()) {
  content_.reserve(kMaxContentBytes);
}
ChunkWriter::~ChunkWriter() = default;

Result<std::string*> ChunkWriter::next_tile(std::size_t most_bytes) {
  if (tiles_ > 0 && content_.size() + most_bytes > kMaxContentBytes) {
    if (auto flushed = flush(); !flushed) return tl::unexpected(flushed.error());
  }
  if (tiles_++ == 0) content_.assign(magic_).append(sizeof tiles_, '\0');
  return &content_;
}

Result<void> ChunkWriter::flush() {
  std::memcpy(content_.data() + magic_.size(), &tiles_, sizeof tiles_);
  tiles_ = 0;
  hash_.update(content_);
  std::string& chunk = compressor_->chunk;
  const std::size_t bytes =
      ZSTD_compressCCtx(compressor_->zstd.get(), chunk.data(), chunk.size(), content_.data(), content_.size(), kLevel);
  if (ZSTD_isError(bytes) != 0U) return fail(ErrorKind::kInternal, fmt::format("zstd: {}", ZSTD_getErrorName(bytes)));
  return sink_(std::string_view(chunk).substr(0, bytes));
}

Result<Hash128> ChunkWriter::finish() {
  if (tiles_ > 0) {
    if (auto flushed = flush(); !flushed) return tl::unexpected(flushed.error());
  }
  return hash_.digest();
}

Result<ChunkContent> open_chunk(std::string_view chunk, std::string_view magic, std::size_t most_tile_bytes,
                                std::size_t most_tiles) {
  if (chunk.size() > kMaxChunkBytes)
    return refuse(fmt::format("{} bytes; expected at most {}", chunk.size(), kMaxChunkBytes));
  const unsigned long long size = ZSTD_getFrameContentSize(chunk.data(), chunk.size());
  if (size == ZSTD_CONTENTSIZE_ERROR || size == ZSTD_CONTENTSIZE_UNKNOWN) return refuse("no zstd frame of known size");
  const std::size_t most = std::min(kMaxContentBytes, kChunkHeaderBytes + most_tiles * most_tile_bytes);
  if (size <= kChunkHeaderBytes || size > most) {
    return refuse(fmt::format("{} bytes of content; expected {} to {}", size, kChunkHeaderBytes + 1, most));
  }
  // Bytes after the frame, or a second one, would be hidden from the hash of the content.
  if (ZSTD_findFrameCompressedSize(chunk.data(), chunk.size()) != chunk.size())
    return refuse("not one whole zstd frame");
  ChunkContent content;
  content.size = static_cast<std::size_t>(size);
  content.bytes = std::make_unique_for_overwrite<char[]>(content.size);
  const std::size_t got = ZSTD_decompress(content.bytes.get(), content.size, chunk.data(), chunk.size());
  if (ZSTD_isError(got) != 0U || got != content.size) return refuse("does not decompress");
  if (!content.all().starts_with(magic)) return refuse(fmt::format("not of kind {}", magic));
  std::memcpy(&content.tiles, content.all().substr(magic.size()).data(), sizeof content.tiles);
  if (content.tiles == 0 || content.tiles > most_tiles) {
    return refuse(fmt::format("{} tiles; expected 1 to {}", content.tiles, most_tiles));
  }
  return content;
}

}  // namespace pf
