#pragma once

#include <array>
#include <cstdint>

#include "common/math/lane_sampling.h"
#include "common/math/philox.h"

namespace pf {

/// Random numbers of photon paths: two blocks of four for the emission (light, position, direction), two for every
/// bounce. The first of a bounce (lobe, direction, roulette) is all that nearly every bounce needs; the other serves
/// the few that need more.
struct PhotonNumbers {
  std::uint64_t seed = 0, sub_pass = 0;

  /// Block `block` of a path: four numbers in [0, 1).
  [[nodiscard]] std::array<float, 4> draw(std::uint32_t path, std::uint32_t block) const {
    const auto bits =
        philox4x32(std::array<std::uint32_t, 4>{path, low(sub_pass), stream(), block}, {low(seed), low(seed >> 32)});
    return {to_unit_float(bits[0]), to_unit_float(bits[1]), to_unit_float(bits[2]), to_unit_float(bits[3])};
  }
  /// Blocks `block` of eight paths: four numbers in [0, 1) each.
  [[nodiscard]] std::array<Float8, 4> draw(const Uint8& path, const Uint8& block) const {
    const auto bits = philox4x32(std::array<Uint8, 4>{path, Uint8{} + low(sub_pass), Uint8{} + stream(), block},
                                 {low(seed), low(seed >> 32)});
    return {to_unit_float(bits[0]), to_unit_float(bits[1]), to_unit_float(bits[2]), to_unit_float(bits[3])};
  }
  /// One number beyond the first block of a path's bounce.
  [[nodiscard]] float late(std::uint32_t path, int bounce) const { return draw(path, block_of(bounce) + 1)[0]; }
  [[nodiscard]] static constexpr std::uint32_t block_of(int bounce) {
    return 2 + 2 * static_cast<std::uint32_t>(bounce);
  }

 private:
  [[nodiscard]] static std::uint32_t low(std::uint64_t v) { return static_cast<std::uint32_t>(v); }
  [[nodiscard]] std::uint32_t stream() const {
    return low(sub_pass >> 32) ^ (static_cast<std::uint32_t>(Stream::kPhoton) << 16);
  }
};

}  // namespace pf
