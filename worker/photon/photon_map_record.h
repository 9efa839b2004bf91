#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "common/math/owen_sobol.h"
#include "common/math/vec.h"
#include "worker/photon/photon.h"

namespace pf {

/// A photon as the map keeps it, 20 bytes [Jensen 2001, 6.2; Jensen 1996, 3.1]. Bytes in memory order,
/// little-endian:
///
///   0  position   three floats [m]
///   12 flux       RGBE [Ward 1991, "Real Pixels"]: three 8-bit mantissas and a shared exponent of 2, excess
///   128 16 direction  towards where the photon came from: octahedral map, 8 bits an axis (Jensen: two
///   spherical angles) 18 flags      bits 0-1: axis of the kd-tree's split; bits 2-15: geometric normal on
///   the side that the photon came from,
///                 octahedral map, 7 bits an axis: which surface it lies on, and on which side
struct StoredPhoton {
  std::array<float, 3> position;
  std::array<std::uint8_t, 4> flux;
  std::uint16_t direction;
  std::uint16_t flags;

  [[nodiscard]] Vec3f point() const { return {position[0], position[1], position[2]}; }
  [[nodiscard]] unsigned axis() const { return flags & 3u; }
};
static_assert(sizeof(StoredPhoton) == 20);

/// Steps an axis of the octahedral maps; even, so that 0 is among them and normals along an axis are exact.
inline constexpr std::uint32_t kDirectionSteps = 254, kNormalMapSteps = 126;

/// Unit vector as two coordinates of 0..steps, from the 16 bits an axis of pack_direction().
template <std::uint32_t kSteps, unsigned kBits>
[[nodiscard]] inline std::uint32_t pack_octahedral(const Vec3f& d) {
  const std::uint32_t fine = pack_direction(d);
  const auto coarse = [](std::uint32_t x) { return (x * kSteps + 32767u) / 65535u; };
  return coarse(fine & 0xFFFFu) | coarse(fine >> 16) << kBits;
}
template <std::uint32_t kSteps, unsigned kBits>
[[nodiscard]] inline Vec3f unpack_octahedral(std::uint32_t packed) {
  const auto fine = [](std::uint32_t x) { return (x * 65535u + kSteps / 2) / kSteps; };
  return unpack_direction(fine(packed & ((1u << kBits) - 1u)) | fine(packed >> kBits) << 16);
}

/// Angle between a direction and what becomes of it in 16 bits, and of a normal in 14, at most [rad].
inline constexpr float kDirectionError = 0.0175f, kNormalError = 0.035f;

[[nodiscard]] inline Vec3f towards_light(const StoredPhoton& p) {
  return unpack_octahedral<kDirectionSteps, 8>(p.direction);
}
[[nodiscard]] inline Vec3f surface_normal(const StoredPhoton& p) {
  return unpack_octahedral<kNormalMapSteps, 7>(static_cast<std::uint32_t>(p.flags) >> 2);
}

/// RGBE of a colour. Rounded up or down at random, by `random_bits`, so that the mean of many is exact:
/// photons of one flux each, as roulette makes them, would all be rounded the same way, by up to 0.4 %. Each
/// channel errs by less than one step of at most 1/128 of the largest channel. Negative values count as 0;
/// above 2^126 the largest is kept.
[[nodiscard]] inline std::array<std::uint8_t, 4> pack_rgbe(const Rgb& rgb, std::uint32_t random_bits) {
  constexpr float kLargest = 0x1p126f, kSmallest = 0x1p-110f;
  const float largest = std::min(max_component(rgb), kLargest);
  if (!(largest >= kSmallest)) return {0, 0, 0, 0};
  int exponent = std::ilogb(largest) + 1;  // largest / 2^exponent lies in [1/2, 1)
  const auto dither = [](int c, std::uint32_t bits) {
    return static_cast<float>((bits >> (10 * c)) & 1023u) * 0x1p-10f;
  };
  const float scale = std::ldexp(256.0f, -exponent);
  Rgb steps;
  for (int c = 0; c < 3; ++c)
    steps[c] = std::floor(std::clamp(rgb[c], 0.0f, kLargest) * scale + dither(c, random_bits));
  if (max_component(steps) > 255.0f) {
    // Rounded up past the last step: steps twice as large, and other random bits.
    ++exponent;
    for (int c = 0; c < 3; ++c) steps[c] = std::floor(0.5f * steps[c] + dither(c, mix_bits(random_bits)));
  }
  const auto byte = [](float value) { return static_cast<std::uint8_t>(value); };
  return {byte(steps.x), byte(steps.y), byte(steps.z), static_cast<std::uint8_t>(exponent + 128)};
}

[[nodiscard]] inline Rgb unpack_rgbe(const std::array<std::uint8_t, 4>& packed) {
  if (packed[3] == 0) return {0.0f, 0.0f, 0.0f};
  // 2^(e - 128 - 8), built from its bits.
  const auto scale = std::bit_cast<float>((static_cast<std::uint32_t>(packed[3]) + (127u - 136u)) << 23);
  return Rgb{static_cast<float>(packed[0]), static_cast<float>(packed[1]), static_cast<float>(packed[2])} * scale;
}

}  // namespace pf
