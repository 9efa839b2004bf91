#include "common/wire/columns.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>

namespace pf {
namespace {

static_assert(std::endian::native == std::endian::little);

template <typename T>
void load(const std::byte* first, std::size_t stride, std::size_t n, Block& out) {
  for (std::size_t i = 0; i < n; ++i) {
    T value;
    std::memcpy(&value, first + i * stride, sizeof value);
    out[i] = static_cast<std::uint64_t>(static_cast<std::int64_t>(value));
  }
}

/// Values of one column as 64-bit integers; those of signed members are in two's complement.
void load(const Records& records, const Column& column, std::size_t begin, std::size_t n, Block& out) {
  const std::byte* first = records.first + begin * records.stride + column.offset;
  switch (column.type) {
    case ColumnType::kInt64:
      return load<std::int64_t>(first, records.stride, n, out);
    case ColumnType::kUint32:
      return load<std::uint32_t>(first, records.stride, n, out);
    case ColumnType::kInt16:
      return load<std::int16_t>(first, records.stride, n, out);
  }
}

struct Range {
  std::int64_t least = std::numeric_limits<std::int64_t>::max();
  std::int64_t most = std::numeric_limits<std::int64_t>::min();
};

void widen(Range& range, const Block& values, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) {
    const auto value = static_cast<std::int64_t>(values[i]);
    range.least = std::min(range.least, value);
    range.most = std::max(range.most, value);
  }
}

unsigned bytes_for(std::uint64_t value) { return static_cast<unsigned>(std::bit_width(value) + 7) / 8; }

void write_planes(const Block& values, std::uint64_t base, unsigned width, std::size_t n, unsigned char* plane,
                  std::size_t count) {
  for (unsigned k = 0; k < width; ++k, plane += count) {
    // A constant number of rounds is what the compiler makes vector code of.
    if (n == kBlock) {
      for (std::size_t i = 0; i < kBlock; ++i) plane[i] = static_cast<unsigned char>((values[i] - base) >> (8 * k));
    } else {
      for (std::size_t i = 0; i < n; ++i) plane[i] = static_cast<unsigned char>((values[i] - base) >> (8 * k));
    }
  }
}

template <unsigned kWidth>
void read_planes(const unsigned char* planes, std::size_t count, std::size_t n, Block& out) {
  for (std::size_t i = 0; i < n; ++i) {
    std::uint64_t value = 0;
    for (unsigned k = 0; k < kWidth; ++k) value |= std::uint64_t{planes[k * count + i]} << (8 * k);
    out[i] = value;
  }
}

template <typename T>
bool set_limit(PackedColumn& column) {
  constexpr std::int64_t kLeast = std::numeric_limits<T>::min();
  constexpr std::int64_t kMost = std::numeric_limits<T>::max();
  if (column.base < kLeast || column.base > kMost) return false;
  column.limit = static_cast<std::uint64_t>(kMost) - static_cast<std::uint64_t>(column.base);
  return true;
}

bool set_limit(PackedColumn& column) {
  switch (column.type) {
    case ColumnType::kInt64:
      return set_limit<std::int64_t>(column);
    case ColumnType::kUint32:
      return set_limit<std::uint32_t>(column);
    case ColumnType::kInt16:
      return set_limit<std::int16_t>(column);
  }
  return false;
}

}  // namespace

void pack_columns(const Records& records, std::span<const Column> columns, std::string& out) {
  Block values;
  for (const Column& column : columns) {
    Range range;
    for (std::size_t begin = 0; begin < records.count; begin += kBlock) {
      const std::size_t n = std::min(kBlock, records.count - begin);
      load(records, column, begin, n, values);
      widen(range, values, n);
    }
    const auto base = static_cast<std::uint64_t>(range.least);
    const unsigned width = bytes_for(static_cast<std::uint64_t>(range.most) - base);
    out += static_cast<char>(width);
    out.append(reinterpret_cast<const char*>(&base), sizeof base);
    const std::size_t at = out.size();
    out.resize(at + width * records.count);
    auto* planes = reinterpret_cast<unsigned char*>(out.data() + at);
    for (std::size_t begin = 0; width > 0 && begin < records.count; begin += kBlock) {
      const std::size_t n = std::min(kBlock, records.count - begin);
      load(records, column, begin, n, values);
      write_planes(values, base, width, n, planes + begin, records.count);
    }
  }
}

bool take_columns(std::string_view& rest, std::span<const Column> columns, std::size_t count,
                  std::span<PackedColumn> out) {
  for (std::size_t c = 0; c < columns.size(); ++c) {
    PackedColumn& column = out[c];
    if (rest.size() < kColumnHeaderBytes) return false;
    column.type = columns[c].type;
    column.width = static_cast<unsigned char>(rest.front());
    std::memcpy(&column.base, rest.data() + 1, sizeof column.base);
    rest.remove_prefix(kColumnHeaderBytes);
    if (column.width > bytes_of(column.type) || !set_limit(column) || rest.size() < column.width * count) return false;
    column.planes = reinterpret_cast<const unsigned char*>(rest.data());
    rest.remove_prefix(column.width * count);
  }
  return true;
}

void read_block(const PackedColumn& column, std::size_t count, std::size_t begin, std::size_t n, Block& out) {
  const unsigned char* planes = column.planes + begin;
  switch (column.width) {
    case 0:
      return read_planes<0>(planes, count, n, out);
    case 1:
      return read_planes<1>(planes, count, n, out);
    case 2:
      return read_planes<2>(planes, count, n, out);
    case 3:
      return read_planes<3>(planes, count, n, out);
    case 4:
      return read_planes<4>(planes, count, n, out);
    case 5:
      return read_planes<5>(planes, count, n, out);
    case 6:
      return read_planes<6>(planes, count, n, out);
    case 7:
      return read_planes<7>(planes, count, n, out);
    default:
      return read_planes<8>(planes, count, n, out);
  }
}

}  // namespace pf
