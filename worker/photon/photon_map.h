#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/math/vec.h"
#include "worker/photon/photon.h"
#include "worker/photon/photon_map_bricks.h"
#include "worker/photon/photon_map_record.h"
#include "worker/photon/photon_tree.h"

namespace pf {

/// The photons nearest to a point, among those on its surface: where a DiscQuery of the same point, with the
/// photon's distance for its radius, would accept the photon. So a photon off the tangent plane counts as
/// kPlaneTolerance^-1 times its height away, and one on a surface that faces elsewhere does not count.
struct NearestQuery {
  Vec3f position;
  Vec3f normal;                     ///< unit geometric normal on the side that is seen
  float max_distance2 = kInfinity;  ///< m^2
  std::uint32_t nearest = 1;        ///< how many, at least 1
  bool both_sides = false;          ///< also photons that came from behind (rough transmission)
};

/// Photons of an answer, and the disc that they fill. Kept by the caller, one a thread, so that queries
/// allocate nothing.
///
/// When `nearest` photons are found within the maximum distance, the farthest of them sets the radius and is
/// not among the photons: the others then lie in the disc as they may, and (k-1)/(pi r^2) is their density
/// without bias [Loftsgaarden and Quesenberry 1965; Moore and Yackel 1977], which k/(pi r^2) of [Jensen
/// 2001, 7.1] overestimates. Else the radius is the maximum distance, and all photons found count; the
/// density is without bias over both cases.
struct NearestPhotons {
  std::vector<std::uint32_t> index;  ///< for PhotonMap::photon()
  std::vector<float> distance2;      ///< as the query counts distance [m^2]
  std::size_t count = 0;             ///< of both above
  float radius2 = 0;                 ///< m^2
};

/// Photons in a left-balanced kd-tree without pointers [Jensen 2001, 6.2]: the children of node i, counted
/// from 1, are 2i and 2i+1, and every level but the last is full. 20 bytes a photon.
class PhotonMap {
 public:
  PhotonMap() = default;
  /// Sorts all photons of `flows` into one tree, in parallel; the same bytes on any number of threads.
  explicit PhotonMap(std::span<const Photons* const> flows);

  [[nodiscard]] std::size_t size() const { return count_; }
  [[nodiscard]] bool empty() const { return count_ == 0; }
  /// Photon of node `index`, from 1 to size().
  [[nodiscard]] const StoredPhoton& photon(std::uint32_t index) const { return photons_[index]; }
  [[nodiscard]] std::span<const StoredPhoton> photons() const { return std::span(photons_).subspan(empty() ? 0 : 1); }
  [[nodiscard]] std::size_t bytes() const { return photons_.size() * sizeof(StoredPhoton); }
  /// What queries need besides.
  [[nodiscard]] std::size_t search_bytes() const { return bricks_.bytes(); }

  /// The photons of an answer, always in the same order.
  void nearest(const NearestQuery& query, NearestPhotons& found) const;
  /// Index of the nearest photon that the query accepts, or 0; query.nearest does not count.
  [[nodiscard]] std::uint32_t nearest_one(const NearestQuery& query) const;
  /// Whether the query accepts the photon within its maximum distance, and how far away it then is: what
  /// searching must find. Infinite where it is on another surface.
  [[nodiscard]] float distance2(const NearestQuery& query, std::uint32_t index) const;
  /// For tests and benches to compare: results are the same to the bit.
  void use_isa(PhotonTree::Isa isa) { isa_ = isa; }

 private:
  std::vector<StoredPhoton> photons_;  ///< [0] is not used
  std::size_t count_ = 0;
  MapBricks bricks_;
  PhotonTree::Isa isa_ = PhotonTree::best_isa();
};

}  // namespace pf
