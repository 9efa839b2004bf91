#include "worker/photon/photon_tree.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "common/base/parallel.h"

namespace pf {
namespace {

constexpr int kAxisBits = 21;

/// Hilbert's curve in three dimensions by a table: a cube's state is where the curve enters it and along which axis it leaves
/// [Hamilton 2006, "Compact Hilbert Indices", sections 2.1 and 3]. An entry holds for two levels at once.
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

/// Photons along a Hilbert curve of 21 bits an axis: photons of a small caustic stay apart in a large scene. Unlike Morton's,
/// the curve never jumps, so that any run of photons is compact: a query meets a fifth fewer blocks and a third fewer nodes.
std::vector<std::uint32_t> hilbert_order(const Photons& p) {
  const Box3f box = bounds_of(p);
  const Vec3f size = box.size();
  const float extent = std::max({size.x, size.y, size.z, std::numeric_limits<float>::min()});
  const float scale = 2097151.0f / extent;
  std::vector<Keyed> keyed(p.size());
  constexpr std::size_t kGrain = 16384;
  parallel_ranges(p.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3f& at = p[i].position;
      const auto cell = [&](float v, float low) { return spread_bits(static_cast<std::uint64_t>((v - low) * scale)); };
      const std::uint64_t morton =
          cell(at.x, box.min.x) | cell(at.y, box.min.y) << 1 | cell(at.z, box.min.z) << 2;
      keyed[i] = {hilbert_key(morton), static_cast<std::uint32_t>(i)};
    }
  });
  // Least-significant-digit radix sort; 63 key bits in six passes.
  constexpr int kDigitBits = 11;
  constexpr std::size_t kDigits = std::size_t{1} << kDigitBits;
  std::vector<Keyed> other(keyed.size());
  for (int shift = 0; shift < 63; shift += kDigitBits) {
    std::array<std::uint32_t, kDigits> start{};
    for (const Keyed& k : keyed) ++start[(k.key >> shift) & (kDigits - 1)];
    if (std::find(start.begin(), start.end(), keyed.size()) != start.end()) continue;  // all the same digit
    std::uint32_t sum = 0;
    for (std::uint32_t& s : start) sum += std::exchange(s, sum);
    for (const Keyed& k : keyed) other[start[(k.key >> shift) & (kDigits - 1)]++] = k;
    keyed.swap(other);
  }
  other = {};  // before the next allocation: with 32 bytes a photon, sorting stays within 64
  std::vector<std::uint32_t> order(keyed.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = keyed[i].index;
  return order;
}

}  // namespace

PhotonTree::PhotonTree(Photons photons) : count_(photons.size()) {
  if (count_ == 0) return;
  fill_blocks(photons);
  photons = {};
  build_levels();
  summarise_blocks();
}

void PhotonTree::fill_blocks(const Photons& photons) {
  const std::vector<std::uint32_t> order = hilbert_order(photons);
  blocks_.resize((count_ + kWidth - 1) / kWidth);
  constexpr std::size_t kGrain = 1024;
  parallel_ranges(blocks_.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Block& block = blocks_[i];
      const std::size_t used = std::min(kWidth, count_ - i * kWidth);
      for (std::size_t k = 0; k < used; ++k) {
        const Photon& photon = photons[order[i * kWidth + k]];
        block.x[k] = photon.position.x, block.y[k] = photon.position.y, block.z[k] = photon.position.z;
        block.r[k] = photon.flux.x, block.g[k] = photon.flux.y, block.b[k] = photon.flux.z;
        block.direction[k] = photon.direction, block.normal[k] = photon.normal;
      }
      for (std::size_t k = used; k < kWidth; ++k) block.x[k] = block.y[k] = block.z[k] = kInfinity;
    }
  });
}

void PhotonTree::summarise_blocks() {
  float most = 0.0f;
  block_normals_.reserve(blocks_.size());
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const Block& block = blocks_[i];
    const auto used = static_cast<std::ptrdiff_t>(std::min(kWidth, count_ - i * kWidth));
    const std::uint32_t first = block.normal[0];
    const bool same =
        std::all_of(block.normal.begin(), block.normal.begin() + used, [&](std::uint32_t n) { return n == first; });
    block_normals_.push_back(same ? first : kMixedNormals);
    for (const auto* channel : {&block.r, &block.g, &block.b}) {
      for (const float flux : *channel) most = std::max(most, std::abs(flux));
    }
  }
  const double room = 0x1p31 / (double{most} * kFluxSteps + 1.0);
  blocks_in_32_bits_ = static_cast<std::uint32_t>(std::min(room, 0x1p31));
}

void PhotonTree::build_levels() {
  std::size_t boxes = blocks_.size();
  while (true) {
    std::vector<Node> level((boxes + kWidth - 1) / kWidth);
    for (Node& node : level) {
      for (std::size_t a = 0; a < 3; ++a) node.lower[a].fill(kInfinity), node.upper[a].fill(-kInfinity);
    }
    for (std::size_t i = 0; i < boxes; ++i) {
      for (std::size_t a = 0; a < 3; ++a) {
        float& lower = level[i / kWidth].lower[a][i % kWidth];
        float& upper = level[i / kWidth].upper[a][i % kWidth];
        if (levels_.empty()) {
          const auto& values = a == 0 ? blocks_[i].x : a == 1 ? blocks_[i].y : blocks_[i].z;
          const std::size_t used = std::min(kWidth, count_ - i * kWidth);
          for (std::size_t k = 0; k < used; ++k) lower = std::min(lower, values[k]), upper = std::max(upper, values[k]);
        } else {
          const Node& child = levels_.back()[i];
          for (const float v : child.lower[a]) lower = std::min(lower, v);
          for (const float v : child.upper[a]) upper = std::max(upper, v);
        }
      }
    }
    boxes = level.size();
    levels_.push_back(std::move(level));
    if (boxes == 1) break;
  }
}

PhotonTree::Isa PhotonTree::best_isa() {
  const bool wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                    __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
  return wide ? Isa::kAvx512 : Isa::kAvx2;
}

namespace {

const GatherKernels& kernels_of(const PhotonTree& tree) {
  return tree.isa() == PhotonTree::Isa::kAvx512 ? gather_kernels_avx512() : gather_kernels_avx2();
}
std::uint32_t count_photons(const PhotonTree& tree, const DiscQuery& query, NearbyBlocks* nearby) {
  return tree.size() == 0 ? 0 : kernels_of(tree).count(tree, query, nearby);
}
FluxSum sum_of_photons(const PhotonTree& tree, const DiscQuery& query, NearbyBlocks* nearby) {
  return tree.size() == 0 ? FluxSum{} : kernels_of(tree).sum_flux(tree, query, nearby);
}
void append_photons(const PhotonTree& tree, const DiscQuery& query, NearbyBlocks* nearby,
                    std::vector<std::uint32_t>& indices) {
  if (tree.size() != 0) kernels_of(tree).collect(tree, query, nearby, indices);
}

}  // namespace

std::uint32_t PhotonTree::count(const DiscQuery& query) const { return count_photons(*this, query, nullptr); }
FluxSum PhotonTree::sum_flux(const DiscQuery& query) const { return sum_of_photons(*this, query, nullptr); }
void PhotonTree::collect(const DiscQuery& query, std::vector<std::uint32_t>& indices) const {
  append_photons(*this, query, nullptr, indices);
}

std::uint32_t GatherCursor::count(const DiscQuery& query) { return count_photons(tree_, query, &nearby_); }
FluxSum GatherCursor::sum_flux(const DiscQuery& query) { return sum_of_photons(tree_, query, &nearby_); }
void GatherCursor::collect(const DiscQuery& query, std::vector<std::uint32_t>& indices) {
  append_photons(tree_, query, &nearby_, indices);
}

}  // namespace pf
