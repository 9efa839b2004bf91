#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/math/vec.h"
#include "worker/photon/photon_map_record.h"

namespace pf {

/// What queries of a photon map read: its tree cut into bricks of four levels. A brick holds the positions
/// and normals of its fifteen nodes side by side, and the boxes of the up to sixteen subtrees below it, so
/// that one pass of vector code tests them all. A binary tree of single records costs two to three times as
/// much: a wait for memory and a guess at every node.
///
/// Beside the map's own records this takes 224 bytes a brick, 15 to 30 a photon.
class MapBricks {
 public:
  static constexpr std::size_t kWidth = 16;
  static constexpr unsigned kHeight = 4;  ///< levels of a brick, of all but the first
  static constexpr std::size_t kMostLevels = 8;

  /// Node (root << d) + i of the tree, at depth d below the brick's root, is lane 2^d - 1 + i. A lane without
  /// a photon is nowhere: its coordinates are NaN, which pass no test.
  struct alignas(32) Brick {
    std::array<float, kWidth> x, y, z;
    std::array<std::uint16_t, kWidth> normal;  ///< as in StoredPhoton::flags, shifted down
  };
  /// Of the subtrees below a brick.
  struct alignas(64) Boxes {
    std::array<std::array<float, kWidth>, 3> low, high;
  };
  /// Bricks whose roots are nodes root, root + 1, ... of the tree.
  struct Level {
    std::size_t first = 0;
    std::uint32_t root = 1;
    unsigned height = 0;
    [[nodiscard]] std::size_t brick(std::uint32_t node) const { return first + (node - root); }
  };

  MapBricks() = default;
  /// `nodes`: [0] is not used.
  explicit MapBricks(std::span<const StoredPhoton> nodes);

  [[nodiscard]] bool empty() const { return levels_.empty(); }
  [[nodiscard]] const std::vector<Level>& levels() const { return levels_; }
  [[nodiscard]] const Brick& brick(std::size_t index) const { return bricks_[index]; }
  /// Of a brick above the last level.
  [[nodiscard]] const Boxes& boxes(std::size_t index) const { return boxes_[index]; }
  [[nodiscard]] std::size_t bytes() const { return bricks_.size() * sizeof(Brick) + boxes_.size() * sizeof(Boxes); }
  /// Squared radius of a disc that holds so many photons where they are spread evenly over the map's square
  /// [m^2].
  [[nodiscard]] float even_radius2(std::uint32_t photons) const { return area_of_one_ * static_cast<float>(photons); }

 private:
  void fill(std::size_t level, std::size_t i, std::span<const StoredPhoton> nodes, std::vector<Box3f>& bounds);

  std::vector<Level> levels_;
  std::vector<Brick> bricks_;  ///< level by level
  std::vector<Boxes> boxes_;   ///< of all bricks but the last level's
  float area_of_one_ = 0;
};

struct NearestQuery;
struct NearestPhotons;

/// Photons that a query for so many keeps before it drops the far ones.
[[nodiscard]] constexpr std::size_t most_candidates(std::size_t nearest) { return 2 * nearest + 24; }
/// The k-th smallest of the values within (low, high], or within [low, high]: for those that neither
/// interpolation nor vectors tell apart. Kept out of the code for one instruction set.
[[nodiscard]] float kth_between(const float* values, std::size_t count, float low, float high, bool with_low,
                                std::size_t k);

/// The query code, once per instruction set; the same bits from each.
struct MapKernels {
  /// `found` has room for most_candidates() and three registers more.
  void (*nearest)(const MapBricks&, const NearestQuery&, NearestPhotons&);
  std::uint32_t (*nearest_one)(const MapBricks&, const NearestQuery&);
};
[[nodiscard]] const MapKernels& map_kernels_avx2();
[[nodiscard]] const MapKernels& map_kernels_avx512();

}  // namespace pf
