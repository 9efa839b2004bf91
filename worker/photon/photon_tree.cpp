#include "worker/photon/photon_tree.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace pf {
namespace {

/// Spreads the low 21 bits three apart.
std::uint64_t spread_bits(std::uint64_t v) {
  v &= 0x1FFFFF;
  v = (v | v << 32) & 0x1F00000000FFFF;
  v = (v | v << 16) & 0x1F0000FF0000FF;
  v = (v | v << 8) & 0x100F00F00F00F00F;
  v = (v | v << 4) & 0x10C30C30C30C30C3;
  return (v | v << 2) & 0x1249249249249249;
}

Box3f bounds_of(const PhotonArrays& p) {
  Box3f box;
  for (std::size_t i = 0; i < p.size(); ++i) box.extendBy({p.x[i], p.y[i], p.z[i]});
  return box;
}

struct Keyed {
  std::uint64_t key;
  std::uint32_t index;
};

/// Photons in Morton order of 21 bits an axis: photons of a small caustic stay apart in a large scene.
std::vector<std::uint32_t> morton_order(const PhotonArrays& p) {
  const Box3f box = bounds_of(p);
  const Vec3f size = box.size();
  const float extent = std::max({size.x, size.y, size.z, std::numeric_limits<float>::min()});
  const float scale = 2097151.0f / extent;
  std::vector<Keyed> keyed(p.size());
  for (std::size_t i = 0; i < p.size(); ++i) {
    const auto cell = [&](float v, float low) { return static_cast<std::uint64_t>((v - low) * scale); };
    keyed[i] = {spread_bits(cell(p.x[i], box.min.x)) | spread_bits(cell(p.y[i], box.min.y)) << 1 |
                    spread_bits(cell(p.z[i], box.min.z)) << 2,
                static_cast<std::uint32_t>(i)};
  }
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
  other = {};  // before the next allocation: with 32 bytes a photon of arrays, sorting stays within 64
  std::vector<std::uint32_t> order(keyed.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = keyed[i].index;
  return order;
}

}  // namespace

PhotonTree::PhotonTree(PhotonArrays photons) : photons_(std::move(photons)), count_(photons_.size()) {
  if (count_ == 0) return;
  const std::vector<std::uint32_t> order = morton_order(photons_);
  const std::size_t padded = (count_ + kWidth - 1) / kWidth * kWidth;
  photons_.for_each_field([&](auto field) {
    auto& values = photons_.*field;
    std::remove_reference_t<decltype(values)> sorted;
    sorted.resize(padded);
    for (std::size_t i = 0; i < count_; ++i) sorted[i] = values[order[i]];
    values.swap(sorted);
  });
  for (auto* axis : {&photons_.x, &photons_.y, &photons_.z}) {
    std::fill(axis->begin() + static_cast<std::ptrdiff_t>(count_), axis->end(), kInfinity);
  }
  build_levels();
  summarise_blocks();
}

void PhotonTree::summarise_blocks() {
  const auto& normals = photons_.normal;
  for (std::size_t first = 0; first < normals.size(); first += kWidth) {
    const auto begin = normals.begin() + static_cast<std::ptrdiff_t>(first);
    const auto end = normals.begin() + static_cast<std::ptrdiff_t>(std::min(first + kWidth, count_));
    block_normals_.push_back(std::all_of(begin, end, [&](std::uint32_t n) { return n == *begin; }) ? *begin : kMixedNormals);
  }
  float most = 0.0f;
  for (const auto* channel : {&photons_.r, &photons_.g, &photons_.b}) {
    for (const float flux : *channel) most = std::max(most, std::abs(flux));
  }
  const double room = 0x1p31 / (double{most} * kFluxSteps + 1.0);
  blocks_in_32_bits_ = static_cast<std::uint32_t>(std::min(room, 0x1p31));
}

void PhotonTree::build_levels() {
  const std::array<const std::vector<float>*, 3> axes{&photons_.x, &photons_.y, &photons_.z};
  std::size_t boxes = photons_.x.size() / kWidth;
  while (true) {
    Level level;
    const std::size_t padded = (boxes + kWidth - 1) / kWidth * kWidth;
    for (std::size_t a = 0; a < 3; ++a) {
      level.lower[a].assign(padded, kInfinity);
      level.upper[a].assign(padded, -kInfinity);
      for (std::size_t i = 0; i < boxes; ++i) {
        float low = kInfinity;
        float high = -kInfinity;
        for (std::size_t child = i * kWidth; child < (i + 1) * kWidth; ++child) {
          if (levels_.empty() && child >= count_) break;
          low = std::min(low, levels_.empty() ? (*axes[a])[child] : levels_.back().lower[a][child]);
          high = std::max(high, levels_.empty() ? (*axes[a])[child] : levels_.back().upper[a][child]);
        }
        level.lower[a][i] = low;
        level.upper[a][i] = high;
      }
    }
    levels_.push_back(std::move(level));
    if (boxes <= kWidth) break;
    boxes = padded / kWidth;
  }
}

PhotonTree::Isa PhotonTree::best_isa() {
  const bool wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                    __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
  return wide ? Isa::kAvx512 : Isa::kAvx2;
}

namespace {
const GatherKernels& kernels(PhotonTree::Isa isa) {
  return isa == PhotonTree::Isa::kAvx512 ? gather_kernels_avx512() : gather_kernels_avx2();
}
}  // namespace

std::uint32_t PhotonTree::count(const DiscQuery& query) const {
  return count_ == 0 ? 0 : kernels(isa_).count(*this, query);
}
FluxSum PhotonTree::sum_flux(const DiscQuery& query) const {
  return count_ == 0 ? FluxSum{} : kernels(isa_).sum_flux(*this, query);
}
void PhotonTree::collect(const DiscQuery& query, std::vector<std::uint32_t>& indices) const {
  if (count_ != 0) kernels(isa_).collect(*this, query, indices);
}

}  // namespace pf
