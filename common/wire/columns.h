#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace pf {

// How a tile's records (pixel sums, feature sums, radii) become bytes. Each member of the record is a column:
//   u8   width      bytes of a difference, 0 to the member's own size
//   i64  base       the column's least value; little-endian, as everything here
//   then `width` planes of one byte for each record: first the lowest bytes of (value - base), then the next
//   ones
// Neighbours differ little, so that few planes are left; the upper ones are nearly constant and cost zstd
// next to nothing.

enum class ColumnType : std::uint8_t { kInt64, kUint32, kInt16 };

struct Column {
  std::size_t offset;  ///< in the record
  ColumnType type;
};

[[nodiscard]] constexpr std::size_t bytes_of(ColumnType type) {
  return type == ColumnType::kInt64 ? 8 : type == ColumnType::kUint32 ? 4 : 2;
}

inline constexpr std::size_t kColumnHeaderBytes = 9;

/// Most bytes that `count` records take.
[[nodiscard]] constexpr std::size_t most_bytes(std::span<const Column> columns, std::size_t count) {
  std::size_t bytes = 0;
  for (const Column& column : columns) bytes += kColumnHeaderBytes + bytes_of(column.type) * count;
  return bytes;
}

/// Records that are looked at together: a block of them and of one column stays in the innermost cache.
inline constexpr std::size_t kBlock = 64;
using Block = std::array<std::uint64_t, kBlock>;

/// Records in memory, `stride` bytes apart.
struct Records {
  const std::byte* first;
  std::size_t stride;
  std::size_t count;
};

/// Appends all columns of the records.
void pack_columns(const Records& records, std::span<const Column> columns, std::string& out);

/// One column in a received text.
struct PackedColumn {
  ColumnType type = ColumnType::kInt64;
  unsigned width = 0;
  std::int64_t base = 0;
  /// Largest difference that stays in the member's range.
  std::uint64_t limit = 0;
  const unsigned char* planes = nullptr;
};

/// Takes the columns of `count` records off the front of `rest`; false when they are cut short or impossible.
[[nodiscard]] bool take_columns(std::string_view& rest, std::span<const Column> columns, std::size_t count,
                                std::span<PackedColumn> out);

/// Differences of records begin..begin+n of `count`, n <= kBlock. They may exceed the column's limit: the
/// caller looks.
void read_block(const PackedColumn& column, std::size_t count, std::size_t begin, std::size_t n, Block& out);

}  // namespace pf
