#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/math/vec.h"
#include "worker/photon/photon.h"

namespace pf {

/// Which photons a hit point gathers: those within a ball, near the tangent plane, on a surface that faces the same
/// way. The others lie on another surface or behind; they count neither in the flux nor in M, else radii shrink wrongly
/// and light leaks through thin walls.
struct DiscQuery {
  Vec3f position;
  Vec3f normal;             ///< unit geometric normal on the side that is seen
  float radius2 = 0;        ///< m^2
  bool both_sides = false;  ///< also photons that came from behind (rough transmission)
};

/// A photon's surface may tilt by 60 degrees against the hit point's...
inline constexpr float kMinNormalCosine = 0.5f;
/// ... and lie off its tangent plane by this part of the radius: a sphere of twice the radius still fits.
inline constexpr float kPlaneTolerance = 0.25f;

/// Steps per unit of flux in sums over photons; integers, so that a sum has no order.
inline constexpr double kFluxSteps = 0x1p24;
/// Largest flux of one photon, in units of the mean path, whose steps vector code converts exactly.
inline constexpr float kMaxPhotonFlux = 0x1p26f;

struct FluxSum {
  std::uint32_t count = 0;
  std::array<std::int64_t, 3> steps{};
};

/// Photons along a Hilbert curve under an implicit 16-ary tree of boxes: blocks of 16 photons, 16 blocks a node and so
/// on. It has no cell size, so that radii may differ by any factor, and its blocks are what vector instructions take at
/// once.
class PhotonTree {
 public:
  static constexpr std::size_t kWidth = 16;

  /// Photons side by side, each field a vector register on cache lines of its own.
  struct alignas(64) Block {
    std::array<float, kWidth> x, y, z, r, g, b;
    std::array<std::uint32_t, kWidth> direction, normal;
  };
  /// Boxes side by side, by axis.
  struct alignas(64) Node {
    std::array<std::array<float, kWidth>, 3> lower, upper;
  };

  PhotonTree() = default;
  /// Sorts the photons (in parallel); takes them over.
  explicit PhotonTree(Photons photons);

  [[nodiscard]] std::size_t size() const { return count_; }
  /// Number of photons that the query accepts.
  [[nodiscard]] std::uint32_t count(const DiscQuery& query) const;
  /// Number and summed flux of the photons that the query accepts.
  [[nodiscard]] FluxSum sum_flux(const DiscQuery& query) const;
  /// Appends the indices of the accepted photons, ascending.
  void collect(const DiscQuery& query, std::vector<std::uint32_t>& indices) const;

  [[nodiscard]] Rgb flux(std::size_t i) const { return {at(&Block::r, i), at(&Block::g, i), at(&Block::b, i)}; }
  [[nodiscard]] Vec3f towards_light(std::size_t i) const { return unpack_direction(at(&Block::direction, i)); }
  /// The number that a photon carries in place of its direction (PhotonOptions::number_photons).
  [[nodiscard]] std::uint32_t number(std::size_t i) const { return at(&Block::direction, i); }
  [[nodiscard]] Vec3f position(std::size_t i) const { return {at(&Block::x, i), at(&Block::y, i), at(&Block::z, i)}; }

  /// Vector code in use, and a way for tests and benches to compare: results are the same to the bit.
  enum class Isa { kAvx2, kAvx512 };
  [[nodiscard]] static Isa best_isa();
  void use_isa(Isa isa) { isa_ = isa; }
  [[nodiscard]] Isa isa() const { return isa_; }

  /// Nodes of each level, from the boxes of the blocks up; the last has one node. Unused boxes are such that nothing
  /// meets them.
  [[nodiscard]] const std::vector<std::vector<Node>>& levels() const { return levels_; }
  [[nodiscard]] const std::vector<Block>& blocks() const { return blocks_; }
  /// Packed normal of all photons of a block, or kMixedNormals.
  [[nodiscard]] std::uint32_t block_normal(std::size_t block) const { return block_normals_[block]; }
  static constexpr std::uint32_t kMixedNormals = ~0u;  ///< packed ones have 24 bits
  /// Steps of one photon from each of so many blocks sum up in 32 bits, whichever they are; 0: one photon may need
  /// more.
  [[nodiscard]] std::uint32_t blocks_in_32_bits() const { return blocks_in_32_bits_; }

 private:
  template <typename T>
  [[nodiscard]] T at(std::array<T, kWidth> Block::*field, std::size_t i) const {
    return (blocks_[i / kWidth].*field)[i % kWidth];
  }
  void fill_blocks(const Photons& photons);
  void build_levels();
  [[nodiscard]] Node node_of_blocks(std::size_t first) const;
  [[nodiscard]] static Node node_of_nodes(const std::vector<Node>& below, std::size_t first);
  [[nodiscard]] std::size_t used_in_block(std::size_t i) const { return std::min(kWidth, count_ - i * kWidth); }
  void summarise_blocks();

  std::vector<Block> blocks_;  ///< the last one padded with photons infinitely far away
  std::vector<std::vector<Node>> levels_;
  std::vector<std::uint32_t> block_normals_;
  std::uint32_t blocks_in_32_bits_ = 0;
  std::size_t count_ = 0;
  Isa isa_ = best_isa();
};

/// Blocks of a tree that meet a ball, with their boxes side by side.
struct NearbyBlocks {
  static constexpr std::size_t kMost = 128;
  Vec3f centre{0, 0, 0};
  float reach = -1.0f;  ///< radius of the ball [m]; negative: none yet
  std::size_t count = 0;
  int queries_to_skip = 0;  ///< the last ball met too many blocks: so many queries ask the tree itself
  std::array<PhotonTree::Node, kMost / PhotonTree::kWidth> boxes;
  std::array<std::uint32_t, kMost> blocks;  ///< ascending
};

/// Queries to one tree, one after the other: neighbouring pixels meet nearly the same blocks, which are looked up in
/// the tree once for several of them. Answers are those of the tree, to the bit. For one thread; the tree must outlive
/// it.
class GatherCursor {
 public:
  explicit GatherCursor(const PhotonTree& tree) : tree_(tree) {}
  [[nodiscard]] std::uint32_t count(const DiscQuery& query);
  [[nodiscard]] FluxSum sum_flux(const DiscQuery& query);
  void collect(const DiscQuery& query, std::vector<std::uint32_t>& indices);
  [[nodiscard]] const PhotonTree& tree() const { return tree_; }

 private:
  const PhotonTree& tree_;
  NearbyBlocks nearby_;
};

/// The query code, once per instruction set; `nearby` may be null.
struct GatherKernels {
  std::uint32_t (*count)(const PhotonTree&, const DiscQuery&, NearbyBlocks* nearby);
  FluxSum (*sum_flux)(const PhotonTree&, const DiscQuery&, NearbyBlocks* nearby);
  void (*collect)(const PhotonTree&, const DiscQuery&, NearbyBlocks* nearby, std::vector<std::uint32_t>&);
};
[[nodiscard]] const GatherKernels& gather_kernels_avx2();
[[nodiscard]] const GatherKernels& gather_kernels_avx512();

}  // namespace pf
