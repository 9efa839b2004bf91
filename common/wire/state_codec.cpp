// Tiles of radii (magic "PFR1"), inside the chunks of chunk.h:
//   u32  index of the tile
//   then the columns (columns.h) radius2 of the caustic and the indirect flow and covered_radius, as the bits
//   of floats: those of numbers that are not negative order as the numbers do
// Every tile of the image comes, in order.

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstring>

#include <fmt/format.h>

#include "common/wire/chunk.h"
#include "common/wire/columns.h"
#include "common/wire/statistics_codec.h"

namespace pf {
namespace {

constexpr std::string_view kStateMagic = "PFR1";
constexpr std::uint32_t kInfinityBits = 0x7f800000;  // all finite numbers that are not negative lie below

constexpr std::array kColumns = {
    Column{offsetof(ProgressivePixel, flow) + kCaustic * sizeof(FlowState) + offsetof(FlowState, radius2),
           ColumnType::kUint32},
    Column{offsetof(ProgressivePixel, flow) + kIndirect * sizeof(FlowState) + offsetof(FlowState, radius2),
           ColumnType::kUint32},
    Column{offsetof(ProgressivePixel, covered_radius), ColumnType::kUint32}};
using PackedColumns = std::array<PackedColumn, kColumns.size()>;
constexpr std::size_t kMostStateTileBytes = sizeof(std::uint32_t) + most_bytes(kColumns, kTilePixels);

tl::unexpected<Error> refuse(std::string why) {
  return fail(ErrorKind::kInvalidInput, "chunk refused: " + std::move(why));
}

bool are_radii(const PackedColumns& columns, std::size_t count) {
  Block deltas;
  bool good = true;
  for (const PackedColumn& column : columns) {
    // A covered radius may be infinite: no edge was found near the pixel.
    const std::uint32_t end = &column == &columns.back() ? kInfinityBits + 1 : kInfinityBits;
    for (std::size_t begin = 0; begin < count; begin += kBlock) {
      const std::size_t n = std::min(kBlock, count - begin);
      read_block(column, count, begin, n, deltas);
      // Both below 2^32: the sum cannot wrap.
      for (std::size_t i = 0; i < n; ++i) good &= static_cast<std::uint64_t>(column.base) + deltas[i] < end;
    }
  }
  return good;
}

void set(const PackedColumns& columns, ProgressivePixel* pixels, std::size_t count) {
  Block deltas;
  for (std::size_t c = 0; c < columns.size(); ++c) {
    for (std::size_t begin = 0; begin < count; begin += kBlock) {
      const std::size_t n = std::min(kBlock, count - begin);
      read_block(columns[c], count, begin, n, deltas);
      for (std::size_t i = 0; i < n; ++i) {
        const auto bits = static_cast<std::uint32_t>(static_cast<std::uint64_t>(columns[c].base) + deltas[i]);
        std::memcpy(reinterpret_cast<std::byte*>(pixels + begin + i) + kColumns[c].offset, &bits, sizeof bits);
      }
    }
  }
}

}  // namespace

Result<Hash128> pack_state(const std::vector<ProgressivePixel>& state,
                           const std::function<Result<void>(std::string_view chunk)>& sink) {
  ChunkWriter writer(kStateMagic, sink);
  for (std::size_t begin = 0; begin < state.size(); begin += kTilePixels) {
    const std::size_t count = std::min(kTilePixels, state.size() - begin);
    auto out = writer.next_tile(kMostStateTileBytes);
    if (!out) return tl::unexpected(out.error());
    const auto index = static_cast<std::uint32_t>(begin / kTilePixels);
    (*out)->append(reinterpret_cast<const char*>(&index), sizeof index);
    pack_columns({reinterpret_cast<const std::byte*>(state.data() + begin), sizeof(ProgressivePixel), count}, kColumns,
                 **out);
  }
  return writer.finish();
}

struct StateUnpacker::State {
  ContentHash hash;
  std::size_t next_tile = 0;
};

StateUnpacker::StateUnpacker(std::vector<ProgressivePixel>& into) : into_(into), state_(std::make_unique<State>()) {}
StateUnpacker::~StateUnpacker() = default;
StateUnpacker::StateUnpacker(StateUnpacker&&) noexcept = default;

Result<void> StateUnpacker::add(std::string_view chunk) {
  const std::size_t tiles = most_chunks(into_.size());
  const auto content = open_chunk(chunk, kStateMagic, kMostStateTileBytes, tiles);
  if (!content) return tl::unexpected(content.error());
  // Once to look, once to set: a chunk that is refused leaves no trace.
  for (const bool setting : {false, true}) {
    std::string_view rest = content->body();
    for (std::uint32_t i = 0; i < content->tiles; ++i) {
      const std::size_t expected = state_->next_tile + i;
      std::uint32_t index = 0;
      if (rest.size() < sizeof index) return refuse(fmt::format("tile {} is cut short", expected));
      std::memcpy(&index, rest.data(), sizeof index);
      rest.remove_prefix(sizeof index);
      if (index != expected || expected >= tiles)
        return refuse(fmt::format("tile {} of {}; expected tile {}", index, tiles, expected));
      const std::size_t begin = expected * kTilePixels;
      const std::size_t count = std::min(kTilePixels, into_.size() - begin);
      PackedColumns columns;
      if (!take_columns(rest, kColumns, count, columns)) return refuse(fmt::format("tile {} is malformed", expected));
      if (setting) {
        set(columns, into_.data() + begin, count);
      } else if (!are_radii(columns, count)) {
        return refuse(fmt::format("tile {}: a radius is negative or not finite", expected));
      }
    }
    if (!rest.empty()) return refuse("bytes after its last tile");
  }
  state_->hash.update(content->all());
  state_->next_tile += content->tiles;
  return {};
}

bool StateUnpacker::complete() const { return state_->next_tile == most_chunks(into_.size()); }
Hash128 StateUnpacker::content() const { return state_->hash.digest(); }

}  // namespace pf
