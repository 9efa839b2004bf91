#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "worker/photon/photon_lanes.h"

namespace pf {

/// Photons on their way, side by side: those that go on from a bounce are put next to each other, so that of the
/// packets of eight that are taken from here only the last has empty lanes.
class PhotonPool {
 private:
  template <typename Lanes>
  [[nodiscard]] static auto floats_of(Lanes& p) {
    return std::array{&p.ray.origin.x,    &p.ray.origin.y,    &p.ray.origin.z, &p.ray.direction.x,
                      &p.ray.direction.y, &p.ray.direction.z, &p.position.x,   &p.position.y,
                      &p.position.z,      &p.flux.x,          &p.flux.y,       &p.flux.z};
  }

 public:
  static constexpr std::size_t kCapacity = 256;  ///< all of it stays in the first-level cache

  /// `with_media`: the scene has volumes that photons pass through.
  explicit PhotonPool(bool with_media) : with_media_(with_media) {}

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool has_room() const { return size_ + kLanes <= kCapacity; }
  /// Photons that are added from now on take the places of those that were taken; the others stay to be taken.
  void refill() { size_ = 0; }

  /// The photons from `first` on. Lanes past the end hold anything.
  void take(std::size_t first, PhotonLanes& photons) const {
    for (std::size_t i = 0; i < kFloats; ++i) *floats_of(photons)[i] = _mm256_loadu_ps(&floats_[i][first]);
    const auto load = [&](const auto& from) {
      return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(&from[first]));
    };
    photons.path = reinterpret_cast<Uint8>(load(path_));
    photons.bounce = reinterpret_cast<Int8>(load(bounce_));
    photons.specular_only = reinterpret_cast<Int8>(load(specular_only_));
    if (with_media_) std::copy_n(media_.begin() + static_cast<std::ptrdiff_t>(first), kLanes, photons.media.begin());
  }

  /// Adds the photons of `lanes`.
  void add(unsigned lanes, const PhotonLanes& photons) {
    const auto order = _mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(kOrder[lanes].data())));
    for (std::size_t i = 0; i < kFloats; ++i) {
      _mm256_storeu_ps(&floats_[i][size_], _mm256_permutevar8x32_ps(*floats_of(photons)[i], order));
    }
    const auto store = [&](auto& to, const auto& values) {
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(&to[size_]),
                          _mm256_permutevar8x32_epi32(reinterpret_cast<__m256i>(values), order));
    };
    store(path_, photons.path);
    store(bounce_, photons.bounce);
    store(specular_only_, photons.specular_only);
    std::size_t next = size_;
    if (with_media_) for_each_lane(lanes, [&](std::size_t lane) { media_[next++] = photons.media[lane]; });
    size_ += static_cast<std::size_t>(std::popcount(lanes));
  }

  /// Adds one.
  void add(const WalkingPhoton& photon) {
    std::size_t i = 0;
    for (const Vec3f& v : {photon.ray.origin, photon.ray.direction, photon.position, photon.flux}) {
      for (const float x : {v.x, v.y, v.z}) floats_[i++][size_] = x;
    }
    path_[size_] = photon.path;
    bounce_[size_] = photon.bounce;
    specular_only_[size_] = photon.specular_only ? -1 : 0;
    if (with_media_) media_[size_] = photon.media;
    ++size_;
  }

 private:
  static constexpr std::size_t kFloats = 12;
  template <typename T>
  using Row = std::array<T, kCapacity + kLanes>;  // eight are written at a time, wherever the last one goes

  /// For each set of lanes: those of it, in order.
  static constexpr auto kOrder = [] {
    std::array<std::array<std::uint8_t, kLanes>, 1u << kLanes> order{};
    for (unsigned lanes = 0; lanes < order.size(); ++lanes) {
      std::size_t next = 0;
      for (std::uint8_t lane = 0; lane < kLanes; ++lane) {
        if ((lanes >> lane & 1u) != 0) order[lanes][next++] = lane;
      }
    }
    return order;
  }();

  std::array<Row<float>, kFloats> floats_;
  Row<std::uint32_t> path_;
  Row<std::int32_t> bounce_, specular_only_;
  Row<MediumStack> media_;
  std::size_t size_ = 0;
  bool with_media_;
};

}  // namespace pf
