#include "worker/photon/hilbert_order.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <utility>

#include "common/base/parallel.h"

namespace pf {
namespace {

constexpr int kAxisBits = 21;

/// Hilbert's curve in three dimensions by a table: a cube's state is where the curve enters it and along which axis it
/// leaves [Hamilton 2006, "Compact Hilbert Indices", sections 2.1 and 3]. An entry holds for two levels at once.
struct HilbertTable {
  static constexpr unsigned kStates = 24;
  struct Step {
    std::uint8_t place;  ///< of the cell along the curve
    std::uint8_t state;  ///< of the cell
  };
  std::array<std::array<Step, 64>, kStates> steps{};

  static constexpr unsigned rotate_left(unsigned v, unsigned by) { return (v << by | v >> (3 - by)) & 7; }
  static constexpr unsigned gray(unsigned v) { return v ^ (v >> 1); }

  /// Octant `cell` of a cube in `state` = 3 * entry + axis.
  static constexpr Step one_level(unsigned state, unsigned cell) {
    const unsigned entry = state / 3, turn = (state % 3 + 1) % 3;
    const unsigned turned = rotate_left(cell ^ entry, (3 - turn) % 3);
    const unsigned w = turned ^ (turned >> 1) ^ (turned >> 2);  // the inverse of gray()
    const unsigned inner_entry = w == 0 ? 0 : gray((w - 1) / 2 * 2);
    const unsigned odd = w % 2 == 1 ? w : w - 1;
    const unsigned inner_axis = w == 0 ? 0 : static_cast<unsigned>(std::countr_one(odd)) % 3;
    const unsigned next = 3 * (entry ^ rotate_left(inner_entry, turn)) + (state % 3 + inner_axis + 1) % 3;
    return {static_cast<std::uint8_t>(w), static_cast<std::uint8_t>(next)};
  }
  constexpr HilbertTable() {
    for (unsigned state = 0; state < kStates; ++state) {
      for (unsigned cells = 0; cells < 64; ++cells) {
        const Step outer = one_level(state, cells >> 3);
        const Step inner = one_level(outer.state, cells & 7);
        steps[state][cells] = {static_cast<std::uint8_t>(outer.place << 3 | inner.place), inner.state};
      }
    }
  }
};

/// Spreads the low 21 bits three apart.
std::uint64_t spread_bits(std::uint64_t v) {
  v &= 0x1FFFFF;
  v = (v | v << 32) & 0x1F00000000FFFF;
  v = (v | v << 16) & 0x1F0000FF0000FF;
  v = (v | v << 8) & 0x100F00F00F00F00F;
  v = (v | v << 4) & 0x10C30C30C30C30C3;
  return (v | v << 2) & 0x1249249249249249;
}

/// Place along the curve of the cell whose interleaved coordinates, x lowest, are `morton`.
std::uint64_t hilbert_key(std::uint64_t morton) {
  static constexpr HilbertTable kTable;
  static_assert(kAxisBits % 2 == 1);
  // A level of zeros above makes the number of levels even.
  std::uint64_t key = 0;
  unsigned state = 0;
  for (int shift = 3 * (kAxisBits - 1); shift >= 0; shift -= 6) {
    const HilbertTable::Step step = kTable.steps[state][(morton >> shift) & 63];
    key = key << 6 | step.place;
    state = step.state;
  }
  return key;
}

Box3f bounds_of(const Photons& p) {
  Box3f box;
  for (const Photon& photon : p) box.extendBy(photon.position);
  return box;
}

struct Keyed {
  std::uint64_t key;
  std::uint32_t index;
};

constexpr int kKeyBits = 3 * kAxisBits;
constexpr int kDigitBits = 11;
constexpr std::size_t kDigits = std::size_t{1} << kDigitBits;
/// Photons that one thread counts and moves at a time: enough to make the sums over digits small beside them.
constexpr std::size_t kSortChunk = 32768;

std::size_t digit_of(const Keyed& k, int shift) { return (k.key >> shift) & (kDigits - 1); }

template <class Body>
void for_each_chunk(std::size_t count, const Body& body) {
  parallel_for((count + kSortChunk - 1) / kSortChunk,
               [&](std::size_t c) { body(c, c * kSortChunk, std::min(count, (c + 1) * kSortChunk)); });
}

/// One pass of a radix sort, stable: `from` by the digit at `shift` into `to`. False: all have the same digit, nothing
/// was done.
bool sort_by_digit(const std::vector<Keyed>& from, std::vector<Keyed>& to, int shift) {
  std::vector<std::array<std::uint32_t, kDigits>> places((from.size() + kSortChunk - 1) / kSortChunk);
  for_each_chunk(from.size(), [&](std::size_t c, std::size_t begin, std::size_t end) {
    places[c].fill(0);
    for (std::size_t i = begin; i < end; ++i) ++places[c][digit_of(from[i], shift)];
  });
  std::uint32_t sum = 0;
  for (std::size_t digit = 0; digit < kDigits; ++digit) {
    const std::uint32_t before = sum;
    for (auto& chunk : places) sum += std::exchange(chunk[digit], sum);
    if (sum - before == from.size()) return false;
  }
  for_each_chunk(from.size(), [&](std::size_t c, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) to[places[c][digit_of(from[i], shift)]++] = from[i];
  });
  return true;
}

}  // namespace

std::vector<std::uint32_t> hilbert_order(const Photons& p) {
  const Box3f box = bounds_of(p);
  const Vec3f size = box.size();
  // Finite also where all lie at one place: there nothing is left to order.
  const float scale = std::min(2097151.0f / std::max({size.x, size.y, size.z}), std::numeric_limits<float>::max());
  std::vector<Keyed> keyed(p.size());
  for_each_chunk(p.size(), [&](std::size_t, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3f& at = p[i].position;
      const auto cell = [&](float v, float low) { return spread_bits(static_cast<std::uint64_t>((v - low) * scale)); };
      const std::uint64_t morton = cell(at.x, box.min.x) | cell(at.y, box.min.y) << 1 | cell(at.z, box.min.z) << 2;
      keyed[i] = {hilbert_key(morton), static_cast<std::uint32_t>(i)};
    }
  });
  std::vector<Keyed> other(keyed.size());
  for (int shift = 0; shift < kKeyBits; shift += kDigitBits) {
    if (sort_by_digit(keyed, other, shift)) keyed.swap(other);
  }
  other = {};  // before the next allocation: with 32 bytes a photon, sorting stays within 64
  std::vector<std::uint32_t> order(keyed.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = keyed[i].index;
  return order;
}

}  // namespace pf
