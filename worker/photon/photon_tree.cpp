#include "worker/photon/photon_tree.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "common/base/parallel.h"
#include "worker/photon/hilbert_order.h"

namespace pf {
namespace {

constexpr PhotonTree::Node empty_node() {
  PhotonTree::Node node{};
  for (std::size_t a = 0; a < 3; ++a) node.lower[a].fill(kInfinity), node.upper[a].fill(-kInfinity);
  return node;
}
constexpr PhotonTree::Node kEmptyNode = empty_node();

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
      const std::size_t used = used_in_block(i);
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
  block_normals_.resize(blocks_.size());
  constexpr std::size_t kChunk = 1024;
  std::vector<float> most((blocks_.size() + kChunk - 1) / kChunk, 0.0f);  // of a chunk
  parallel_for(most.size(), [&](std::size_t c) {
    for (std::size_t i = c * kChunk; i < std::min(blocks_.size(), (c + 1) * kChunk); ++i) {
      const Block& block = blocks_[i];
      const auto used = static_cast<std::ptrdiff_t>(used_in_block(i));
      const std::uint32_t first = block.normal[0];
      const bool same =
          std::all_of(block.normal.begin(), block.normal.begin() + used, [&](std::uint32_t n) { return n == first; });
      block_normals_[i] = same ? first : kMixedNormals;
      for (const auto* channel : {&block.r, &block.g, &block.b}) {
        for (const float flux : *channel) most[c] = std::max(most[c], std::abs(flux));
      }
    }
  });
  const double room = 0x1p31 / (double{*std::max_element(most.begin(), most.end())} * kFluxSteps + 1.0);
  blocks_in_32_bits_ = static_cast<std::uint32_t>(std::min(room, 0x1p31));
}

PhotonTree::Node PhotonTree::node_of_blocks(std::size_t first) const {
  Node node = kEmptyNode;
  for (std::size_t i = first; i < std::min(blocks_.size(), first + kWidth); ++i) {
    const std::array fields{&blocks_[i].x, &blocks_[i].y, &blocks_[i].z};
    for (std::size_t a = 0; a < 3; ++a) {
      const auto begin = fields[a]->begin();
      const auto [least, most] = std::minmax_element(begin, begin + static_cast<std::ptrdiff_t>(used_in_block(i)));
      node.lower[a][i - first] = *least, node.upper[a][i - first] = *most;
    }
  }
  return node;
}

PhotonTree::Node PhotonTree::node_of_nodes(const std::vector<Node>& below, std::size_t first) {
  Node node = kEmptyNode;
  for (std::size_t i = first; i < std::min(below.size(), first + kWidth); ++i) {
    for (std::size_t a = 0; a < 3; ++a) {
      node.lower[a][i - first] = *std::min_element(below[i].lower[a].begin(), below[i].lower[a].end());
      node.upper[a][i - first] = *std::max_element(below[i].upper[a].begin(), below[i].upper[a].end());
    }
  }
  return node;
}

void PhotonTree::build_levels() {
  constexpr std::size_t kGrain = 64;
  do {
    const std::size_t children = levels_.empty() ? blocks_.size() : levels_.back().size();
    std::vector<Node> level((children + kWidth - 1) / kWidth);
    parallel_ranges(level.size(), kGrain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        level[i] = levels_.empty() ? node_of_blocks(i * kWidth) : node_of_nodes(levels_.back(), i * kWidth);
      }
    });
    levels_.push_back(std::move(level));
  } while (levels_.back().size() > 1);
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
