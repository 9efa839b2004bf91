// Tiles of pixel and feature sums (magic "PFS1"), inside the chunks of chunk.h:
//   u32  index of the tile
//   u8   parts: bit 0 pixel sums, bit 1 feature sums, bit 2 extra sums; the others are all zero. Never none: such a
//   tile is left out then the columns (columns.h) of each part: direct, flow, square, photons; albedo, normal,
//   depth_and_samples; rgb, marks
// A tile holds kTilePixels pixels, the last one of the image what is left.

#include "common/wire/statistics_codec.h"

#include <algorithm>
#include <array>
#include <cstring>

#include <fmt/format.h>

#include "common/wire/chunk.h"
#include "common/wire/columns.h"

namespace pf {
namespace {

constexpr std::string_view kStatisticsMagic = "PFS1";
enum Part : unsigned char { kPixels = 1, kFeatures = 2, kExtras = 4 };
constexpr std::size_t kTileHeaderBytes = 5;

constexpr std::size_t at(std::size_t member, std::size_t element, std::size_t bytes) {
  return member + element * bytes;
}

constexpr std::array kPixelColumns = [] {
  std::array<Column, 12> columns{};
  std::size_t i = 0;
  for (std::size_t c = 0; c < 3; ++c) columns[i++] = {at(offsetof(PixelSums, direct), c, 8), ColumnType::kInt64};
  for (std::size_t c = 0; c < 3 * kFlows; ++c) columns[i++] = {at(offsetof(PixelSums, flow), c, 8), ColumnType::kInt64};
  columns[i++] = {offsetof(PixelSums, square), ColumnType::kInt64};
  for (std::size_t f = 0; f < kFlows; ++f) columns[i++] = {at(offsetof(PixelSums, photons), f, 4), ColumnType::kUint32};
  return columns;
}();
constexpr std::array kFeatureColumns = [] {
  std::array<Column, 7> columns{};
  std::size_t i = 0;
  for (std::size_t c = 0; c < 3; ++c) columns[i++] = {at(offsetof(FeatureSums, albedo), c, 2), ColumnType::kInt16};
  for (std::size_t c = 0; c < 3; ++c) columns[i++] = {at(offsetof(FeatureSums, normal), c, 2), ColumnType::kInt16};
  columns[i++] = {offsetof(FeatureSums, depth_and_samples), ColumnType::kUint32};
  return columns;
}();
constexpr std::array kExtraColumns = [] {
  std::array<Column, 4> columns{};
  for (std::size_t c = 0; c < 3; ++c) columns[c] = {at(offsetof(ExtraSums, rgb), c, 8), ColumnType::kInt64};
  columns[3] = {offsetof(ExtraSums, marks), ColumnType::kInt64};
  return columns;
}();
static_assert(sizeof(PixelSums) == 88 && sizeof(FeatureSums) == 16 && sizeof(ExtraSums) == 32,
              "a member was added: it needs a column");

constexpr std::size_t kMostStatisticsTileBytes = kTileHeaderBytes + most_bytes(kPixelColumns, kTilePixels) +
                                                 most_bytes(kFeatureColumns, kTilePixels) +
                                                 most_bytes(kExtraColumns, kTilePixels);

template <typename Record>
Records records_of(const std::vector<Record>& records, std::size_t begin, std::size_t count) {
  return {reinterpret_cast<const std::byte*>(records.data() + begin), sizeof(Record), count};
}

template <typename Record>
bool all_zero(const std::vector<Record>& records, std::size_t begin, std::size_t count) {
  static_assert(std::has_unique_object_representations_v<Record>);
  const auto* bytes = reinterpret_cast<const char*>(records.data() + begin);
  // Equal to itself moved by one byte, and the first one zero.
  return bytes[0] == 0 && std::memcmp(bytes, bytes + 1, count * sizeof(Record) - 1) == 0;
}

/// One tile of a chunk that was walked over.
struct Tile {
  std::uint32_t index = 0;
  std::size_t begin = 0;
  std::size_t count = 0;
  unsigned char parts = 0;
  std::array<PackedColumn, kPixelColumns.size()> pixels;
  std::array<PackedColumn, kFeatureColumns.size()> features;
  std::array<PackedColumn, kExtraColumns.size()> extras;
};

bool take_tile(std::string_view& rest, std::size_t image_pixels, Tile& tile) {
  if (rest.size() < kTileHeaderBytes) return false;
  std::memcpy(&tile.index, rest.data(), sizeof tile.index);
  tile.parts = static_cast<unsigned char>(rest[sizeof tile.index]);
  rest.remove_prefix(kTileHeaderBytes);
  if (tile.index >= most_chunks(image_pixels) || tile.parts == 0 || tile.parts > (kPixels | kFeatures | kExtras))
    return false;
  tile.begin = tile.index * kTilePixels;
  tile.count = std::min(kTilePixels, image_pixels - tile.begin);
  return ((tile.parts & kPixels) == 0 || take_columns(rest, kPixelColumns, tile.count, tile.pixels)) &&
         ((tile.parts & kFeatures) == 0 || take_columns(rest, kFeatureColumns, tile.count, tile.features)) &&
         ((tile.parts & kExtras) == 0 || take_columns(rest, kExtraColumns, tile.count, tile.extras));
}

/// What adding or taking off met. Kept apart from the loops, which always run to their end.
struct Trouble {
  bool malformed = false;  ///< a value outside its member's range
  bool overflow = false;
};

enum class Direction { kAdd, kTakeOff };

template <Direction kDirection, typename T>
void apply_column(const PackedColumn& column, std::byte* first, std::size_t stride, std::size_t n, const Block& deltas,
                  Trouble& trouble) {
  bool malformed = false;
  bool overflow = false;
  for (std::size_t i = 0; i < n; ++i) {
    malformed |= deltas[i] > column.limit;
    // Arithmetic modulo 2^bits: what was added in error can be taken off exactly.
    const auto value = static_cast<T>(static_cast<std::uint64_t>(column.base) + deltas[i]);
    T sum;
    std::memcpy(&sum, first + i * stride, sizeof sum);
    if constexpr (kDirection == Direction::kAdd) {
      overflow |= __builtin_add_overflow(sum, value, &sum);
    } else {
      overflow |= __builtin_sub_overflow(sum, value, &sum);
    }
    std::memcpy(first + i * stride, &sum, sizeof sum);
  }
  trouble.malformed |= malformed;
  trouble.overflow |= overflow;
}

template <Direction kDirection>
void apply_block(const PackedColumn& column, std::byte* first, std::size_t stride, std::size_t n, const Block& deltas,
                 Trouble& trouble) {
  switch (column.type) {
    case ColumnType::kInt64:
      return apply_column<kDirection, std::int64_t>(column, first, stride, n, deltas, trouble);
    case ColumnType::kUint32:
      return apply_column<kDirection, std::uint32_t>(column, first, stride, n, deltas, trouble);
    case ColumnType::kInt16:
      return apply_column<kDirection, std::int16_t>(column, first, stride, n, deltas, trouble);
  }
}

template <Direction kDirection, typename Record>
void apply_part(std::span<const Column> columns, std::span<const PackedColumn> packed, Record* records,
                std::size_t count, Trouble& trouble) {
  Block deltas;
  for (std::size_t begin = 0; begin < count; begin += kBlock) {
    const std::size_t n = std::min(kBlock, count - begin);
    for (std::size_t c = 0; c < columns.size(); ++c) {
      read_block(packed[c], count, begin, n, deltas);
      apply_block<kDirection>(packed[c], reinterpret_cast<std::byte*>(records + begin) + columns[c].offset,
                              sizeof(Record), n, deltas, trouble);
    }
  }
}

/// Depth and samples share a word: their sum must not carry from the samples into the depth.
template <Direction kDirection>
void check_samples(const PackedColumn& packed, const FeatureSums* records, std::size_t count, Trouble& trouble) {
  Block deltas;
  for (std::size_t begin = 0; begin < count; begin += kBlock) {
    const std::size_t n = std::min(kBlock, count - begin);
    read_block(packed, count, begin, n, deltas);
    for (std::size_t i = 0; i < n; ++i) {
      const std::uint64_t samples = (static_cast<std::uint64_t>(packed.base) + deltas[i]) & 15u;
      const std::uint64_t held = records[begin + i].samples();
      trouble.overflow |= kDirection == Direction::kAdd ? held + samples > kFeatureSubPasses : held < samples;
    }
  }
}

template <Direction kDirection>
void apply_tile(const Tile& tile, Statistics& into, Trouble& trouble) {
  if ((tile.parts & kPixels) != 0) {
    apply_part<kDirection>(kPixelColumns, tile.pixels, into.pixels.data() + tile.begin, tile.count, trouble);
  }
  if ((tile.parts & kFeatures) != 0) {
    FeatureSums* features = into.features.data() + tile.begin;
    check_samples<kDirection>(tile.features.back(), features, tile.count, trouble);
    apply_part<kDirection>(kFeatureColumns, tile.features, features, tile.count, trouble);
  }
  if ((tile.parts & kExtras) != 0) {
    apply_part<kDirection>(kExtraColumns, tile.extras, into.extras.data() + tile.begin, tile.count, trouble);
  }
}

struct Walk {
  std::size_t end_tile = 0;  ///< the one after the last
  bool features = false;
  bool extras = false;
};

/// Looks at the frame of every tile, so that what follows may trust it.
Result<Walk> walk(const ChunkContent& content, std::size_t image_pixels, std::size_t next_tile) {
  std::string_view rest = content.body();
  Walk walk{next_tile, false, false};
  Tile tile;
  for (std::uint32_t i = 0; i < content.tiles; ++i) {
    if (!take_tile(rest, image_pixels, tile)) {
      return fail(ErrorKind::kInvalidInput, fmt::format("chunk refused: tile {} of {} is malformed", i, content.tiles));
    }
    if (tile.index < walk.end_tile) {
      return fail(ErrorKind::kInvalidInput,
                  fmt::format("chunk refused: tile {} comes twice or out of order; expected {} or more", tile.index,
                              walk.end_tile));
    }
    walk.end_tile = std::size_t{tile.index} + 1;
    walk.features |= (tile.parts & kFeatures) != 0;
    walk.extras |= (tile.parts & kExtras) != 0;
  }
  if (!rest.empty()) return fail(ErrorKind::kInvalidInput, "chunk refused: bytes after its last tile");
  return walk;
}

/// Applies a chunk wholly or not at all.
template <Direction kDirection>
Result<void> apply(const ChunkContent& content, Statistics& into) {
  constexpr Direction kBack = kDirection == Direction::kAdd ? Direction::kTakeOff : Direction::kAdd;
  std::string_view rest = content.body();
  Tile tile;
  Trouble trouble;
  for (std::uint32_t done = 0; done < content.tiles; ++done) {
    if (!take_tile(rest, into.pixels.size(), tile)) break;  // walk() has seen that they are all there
    apply_tile<kDirection>(tile, into, trouble);
    if (!trouble.malformed && !trouble.overflow) continue;
    Trouble ignored;
    rest = content.body();
    for (std::uint32_t back = 0; back <= done && take_tile(rest, into.pixels.size(), tile); ++back) {
      apply_tile<kBack>(tile, into, ignored);
    }
    if (trouble.malformed)
      return fail(ErrorKind::kInvalidInput, fmt::format("chunk refused: tile {} holds impossible values", done));
    return fail(ErrorKind::kInternal,
                kDirection == Direction::kAdd
                    ? fmt::format("statistics: sums of tile {} overflow", tile.index)
                    : fmt::format("statistics: tile {} holds less than is to be taken off", tile.index));
  }
  return {};
}

Result<ChunkContent> open_statistics(std::string_view chunk, const Statistics& into) {
  return open_chunk(chunk, kStatisticsMagic, kMostStatisticsTileBytes, most_chunks(into.pixels.size()));
}

}  // namespace

PackedStatistics pack_statistics(const Statistics& statistics) {
  PackedStatistics packed;
  packed.raw_bytes = statistics.pixels.size() * sizeof(PixelSums) + statistics.features.size() * sizeof(FeatureSums) +
                     statistics.extras.size() * sizeof(ExtraSums);
  ChunkWriter writer(kStatisticsMagic, [&](std::string_view chunk) -> Result<void> {
    packed.chunks.emplace_back(chunk);
    return {};
  });
  for (std::size_t begin = 0; begin < statistics.pixels.size(); begin += kTilePixels) {
    const std::size_t count = std::min(kTilePixels, statistics.pixels.size() - begin);
    unsigned char parts = all_zero(statistics.pixels, begin, count) ? 0 : kPixels;
    if (!statistics.features.empty() && !all_zero(statistics.features, begin, count)) parts |= kFeatures;
    if (!statistics.extras.empty() && !all_zero(statistics.extras, begin, count)) parts |= kExtras;
    if (parts == 0) continue;
    // Neither call can fail: compression into a buffer of the bound's size, and a sink that only appends.
    std::string& out = *writer.next_tile(kMostStatisticsTileBytes).value();
    const auto index = static_cast<std::uint32_t>(begin / kTilePixels);
    out.append(reinterpret_cast<const char*>(&index), sizeof index).push_back(static_cast<char>(parts));
    if ((parts & kPixels) != 0) pack_columns(records_of(statistics.pixels, begin, count), kPixelColumns, out);
    if ((parts & kFeatures) != 0) pack_columns(records_of(statistics.features, begin, count), kFeatureColumns, out);
    if ((parts & kExtras) != 0) pack_columns(records_of(statistics.extras, begin, count), kExtraColumns, out);
  }
  packed.content = writer.finish().value();
  return packed;
}

struct StatisticsUnpacker::State {
  ContentHash hash;
  std::size_t next_tile = 0;
};

StatisticsUnpacker::StatisticsUnpacker(Statistics& into) : into_(into), state_(std::make_unique<State>()) {}
StatisticsUnpacker::~StatisticsUnpacker() = default;
StatisticsUnpacker::StatisticsUnpacker(StatisticsUnpacker&&) noexcept = default;

Result<void> StatisticsUnpacker::add(std::string_view chunk) {
  auto content = open_statistics(chunk, into_);
  if (!content) return tl::unexpected(content.error());
  const auto seen = walk(*content, into_.pixels.size(), state_->next_tile);
  if (!seen) return tl::unexpected(seen.error());
  if (seen->features && into_.features.empty()) into_.features.resize(into_.pixels.size());
  if (seen->extras && into_.extras.empty()) into_.extras.resize(into_.pixels.size());
  if (auto added = apply<Direction::kAdd>(*content, into_); !added) return added;
  state_->hash.update(content->all());
  state_->next_tile = seen->end_tile;
  return {};
}

Result<void> StatisticsUnpacker::take_off(std::string_view chunk) {
  auto content = open_statistics(chunk, into_);
  if (!content) return tl::unexpected(content.error());
  const auto seen = walk(*content, into_.pixels.size(), 0);
  if (!seen) return tl::unexpected(seen.error());
  if ((seen->features && into_.features.empty()) || (seen->extras && into_.extras.empty())) {
    return fail(ErrorKind::kInternal, "statistics: sums are to be taken off where there are none");
  }
  return apply<Direction::kTakeOff>(*content, into_);
}

Hash128 StatisticsUnpacker::content() const { return state_->hash.digest(); }

}  // namespace pf
