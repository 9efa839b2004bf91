#include "worker/photon/photon_map.h"

#include <algorithm>
#include <bit>

#include "common/base/parallel.h"

namespace pf {
namespace {

/// What sorting moves: position, and which photon it is.
struct Key {
  std::array<float, 3> position;
  std::uint32_t photon;
};

/// Photons of the left subtree when `count` > 1 of them make a left-balanced tree: all levels full but the
/// last, and that one filled from the left [Jensen 2001, 6.2].
std::size_t left_size(std::size_t count) {
  const std::size_t last_level = std::bit_floor(count);  // room of the last level
  const std::size_t in_last_level = count - (last_level - 1);
  return (last_level / 2 - 1) + std::min(last_level / 2, in_last_level);
}

/// Axis along which the photons extend most.
unsigned widest_axis(std::span<const Key> keys) {
  std::array<float, 3> low = keys[0].position, high = low;
  for (const Key& key : keys) {
    for (std::size_t a = 0; a < 3; ++a) {
      low[a] = std::min(low[a], key.position[a]);
      high[a] = std::max(high[a], key.position[a]);
    }
  }
  unsigned widest = 0;
  for (unsigned a = 1; a < 3; ++a) {
    if (high[a] - low[a] > high[widest] - low[widest]) widest = a;
  }
  return widest;
}

/// Builds the subtree of node `node` from `keys`; below a size where threads no longer help, on one.
class Balancer {
 public:
  Balancer(std::vector<std::uint32_t>& source, std::vector<std::uint8_t>& axes) : source_(source), axes_(axes) {}

  void build(std::span<Key> keys, std::size_t node) {
    if (keys.empty()) return;
    if (keys.size() == 1) {
      place(keys[0], node, 0);
      return;
    }
    const unsigned axis = widest_axis(keys);
    const std::size_t left = left_size(keys.size());
    const auto middle = keys.begin() + static_cast<std::ptrdiff_t>(left);
    std::nth_element(keys.begin(), middle, keys.end(), [axis](const Key& a, const Key& b) {
      return a.position[axis] < b.position[axis] || (a.position[axis] == b.position[axis] && a.photon < b.photon);
    });
    place(*middle, node, axis);
    const auto lower = keys.first(left), upper = keys.subspan(left + 1);
    constexpr std::size_t kTask = 4096;
    if (keys.size() < kTask) {
      build(lower, 2 * node);
      build(upper, 2 * node + 1);
    } else {
      parallel_invoke([&] { build(lower, 2 * node); }, [&] { build(upper, 2 * node + 1); });
    }
  }

 private:
  void place(const Key& key, std::size_t node, unsigned axis) {
    source_[node] = key.photon;
    axes_[node] = static_cast<std::uint8_t>(axis);
  }
  std::vector<std::uint32_t>& source_;
  std::vector<std::uint8_t>& axes_;
};

StoredPhoton make_stored(const Photon& photon, std::uint32_t number, unsigned axis) {
  const auto byte = [&](int k) { return static_cast<float>(static_cast<std::int8_t>(photon.normal >> (8 * k))); };
  const Vec3f normal = normalize(Vec3f(byte(0), byte(1), byte(2)));
  StoredPhoton stored;
  stored.position = {photon.position.x, photon.position.y, photon.position.z};
  stored.flux = pack_rgbe(photon.flux, mix_bits(number ^ 0x9E3779B9u));
  stored.direction =
      static_cast<std::uint16_t>(pack_octahedral<kDirectionSteps, 8>(unpack_direction(photon.direction)));
  stored.flags = static_cast<std::uint16_t>(pack_octahedral<kNormalMapSteps, 7>(normal) << 2 | axis);
  return stored;
}

}  // namespace

PhotonMap::PhotonMap(std::span<const Photons* const> flows) {
  std::vector<std::size_t> starts;
  for (const Photons* flow : flows) {
    starts.push_back(count_);
    count_ += flow->size();
  }
  if (count_ == 0) return;
  constexpr std::size_t kGrain = 16384;
  std::vector<Key> keys(count_);
  for (std::size_t f = 0; f < flows.size(); ++f) {
    const Photons& photons = *flows[f];
    parallel_ranges(photons.size(), kGrain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const Vec3f& at = photons[i].position;
        keys[starts[f] + i] = {{at.x, at.y, at.z}, static_cast<std::uint32_t>(starts[f] + i)};
      }
    });
  }
  std::vector<std::uint32_t> source(count_ + 1);
  std::vector<std::uint8_t> axes(count_ + 1);
  Balancer(source, axes).build(keys, 1);
  keys = {};
  photons_.resize(count_ + 1);
  parallel_ranges(count_, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t node = begin + 1; node <= end; ++node) {
      const std::uint32_t number = source[node];
      const auto after = std::upper_bound(starts.begin(), starts.end(), std::size_t{number});
      const auto f = static_cast<std::size_t>(after - starts.begin()) - 1;
      photons_[node] = make_stored((*flows[f])[number - starts[f]], number, axes[node]);
    }
  });
  bricks_ = MapBricks(photons_);
}

}  // namespace pf
