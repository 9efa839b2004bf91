#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/math/vec.h"
#include "worker/photon/photon.h"

namespace pf {

/// Which photons a hit point gathers: those within a ball, near the tangent plane, on a surface that faces the same way.
/// The others lie on another surface or behind; they count neither in the flux nor in M, else radii shrink wrongly and
/// light leaks through thin walls.
struct DiscQuery {
  Vec3f position;
  Vec3f normal;              ///< unit geometric normal on the side that is seen
  float radius2 = 0;         ///< m^2
  bool both_sides = false;   ///< also photons that came from behind (rough transmission)
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

/// Photons in Morton order under an implicit 16-ary tree of boxes: blocks of 16 photons, 16 blocks a node and so on. It has no
/// cell size, so that radii may differ by any factor, and its blocks are what vector instructions take at once.
class PhotonTree {
 public:
  static constexpr std::size_t kWidth = 16;

  PhotonTree() = default;
  /// Sorts the photons (in parallel); takes them over.
  explicit PhotonTree(PhotonArrays photons);

  [[nodiscard]] std::size_t size() const { return count_; }
  /// Number of photons that the query accepts.
  [[nodiscard]] std::uint32_t count(const DiscQuery& query) const;
  /// Number and summed flux of the photons that the query accepts.
  [[nodiscard]] FluxSum sum_flux(const DiscQuery& query) const;
  /// Appends the indices of the accepted photons, ascending.
  void collect(const DiscQuery& query, std::vector<std::uint32_t>& indices) const;

  [[nodiscard]] Rgb flux(std::size_t i) const { return {photons_.r[i], photons_.g[i], photons_.b[i]}; }
  [[nodiscard]] Vec3f towards_light(std::size_t i) const { return unpack_direction(photons_.direction[i]); }
  [[nodiscard]] Vec3f position(std::size_t i) const { return {photons_.x[i], photons_.y[i], photons_.z[i]}; }

  /// Vector code in use, and a way for tests and benches to compare: results are the same to the bit.
  enum class Isa { kAvx2, kAvx512 };
  [[nodiscard]] static Isa best_isa();
  void use_isa(Isa isa) { isa_ = isa; }

  /// Boxes of one level, one array a bound, padded to whole nodes with boxes that nothing meets.
  struct Level {
    std::array<std::vector<float>, 3> lower, upper;
  };
  [[nodiscard]] const std::vector<Level>& levels() const { return levels_; }
  [[nodiscard]] const PhotonArrays& photons() const { return photons_; }
  /// Packed normal of all photons of the block at `first`, or kMixedNormals.
  [[nodiscard]] std::uint32_t block_normal(std::size_t first) const { return block_normals_[first / kWidth]; }
  static constexpr std::uint32_t kMixedNormals = ~0u;   ///< packed ones have 24 bits
  /// Steps of one photon from each of so many blocks sum up in 32 bits, whichever they are; 0: one photon may need more.
  [[nodiscard]] std::uint32_t blocks_in_32_bits() const { return blocks_in_32_bits_; }

 private:
  void build_levels();
  void summarise_blocks();

  PhotonArrays photons_;          ///< padded to whole blocks with photons infinitely far away
  std::vector<Level> levels_;     ///< [0]: boxes of the blocks; the last has at most kWidth boxes
  std::vector<std::uint32_t> block_normals_;
  std::uint32_t blocks_in_32_bits_ = 0;
  std::size_t count_ = 0;
  Isa isa_ = best_isa();
};

/// The query code, once per instruction set.
struct GatherKernels {
  std::uint32_t (*count)(const PhotonTree&, const DiscQuery&);
  FluxSum (*sum_flux)(const PhotonTree&, const DiscQuery&);
  void (*collect)(const PhotonTree&, const DiscQuery&, std::vector<std::uint32_t>&);
};
[[nodiscard]] const GatherKernels& gather_kernels_avx2();
[[nodiscard]] const GatherKernels& gather_kernels_avx512();

}  // namespace pf
