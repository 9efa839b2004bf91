#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "common/math/vec.h"
#include "worker/photon/irradiance_hemisphere.h"

namespace pf {

/// A float's upper half: 8 bits of mantissa.
[[nodiscard]] inline float unpack_half(std::uint16_t bits) { return std::bit_cast<float>(std::uint32_t{bits} << 16); }
/// The least such number that is not below a non-negative `value`; infinity stays.
[[nodiscard]] inline std::uint16_t pack_half_up(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  return static_cast<std::uint16_t>(std::isinf(value) ? bits >> 16 : (bits + 0xFFFFu) >> 16);
}

/// How far the gather rays of a record went and what they brought: all that telling needs which changes of a
/// scene can have touched the record. Their directions follow from the record's random numbers. Four bytes a
/// ray.
struct RecordReach {
  std::vector<std::uint16_t> distance;   ///< by cell [m], rounded up
  std::vector<std::uint16_t> luminance;  ///< of the radiance, rounded up

  RecordReach() = default;
  explicit RecordReach(const HemisphereSamples& samples) {
    for (std::size_t cell = 0; cell < samples.distance.size(); ++cell) {
      distance.push_back(pack_half_up(samples.distance[cell]));
      luminance.push_back(pack_half_up(pf::luminance(samples.radiance[cell])));
    }
  }
};

}  // namespace pf
