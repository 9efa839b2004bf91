#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/math/vec.h"

namespace pf {

/// Unit vector in 32 bits: octahedral map, 16 bits an axis [Cigolla et al. 2014]. Error below 1e-4 rad.
[[nodiscard]] inline std::uint32_t pack_direction(const Vec3f& d) {
  const float scale = 1.0f / (std::abs(d.x) + std::abs(d.y) + std::abs(d.z));
  float u = d.x * scale;
  float v = d.y * scale;
  if (d.z < 0.0f) {
    const float folded = (1.0f - std::abs(v)) * std::copysign(1.0f, u);
    v = (1.0f - std::abs(u)) * std::copysign(1.0f, v);
    u = folded;
  }
  const auto quantise = [](float x) { return static_cast<std::uint32_t>(std::lrint((x * 0.5f + 0.5f) * 65535.0f)); };
  return quantise(u) | (quantise(v) << 16);
}

[[nodiscard]] inline Vec3f unpack_direction(std::uint32_t bits) {
  const float u = static_cast<float>(bits & 0xFFFFu) * (2.0f / 65535.0f) - 1.0f;
  const float v = static_cast<float>(bits >> 16) * (2.0f / 65535.0f) - 1.0f;
  Vec3f d{u, v, 1.0f - std::abs(u) - std::abs(v)};
  if (d.z < 0.0f) {
    d.x = (1.0f - std::abs(v)) * std::copysign(1.0f, u);
    d.y = (1.0f - std::abs(u)) * std::copysign(1.0f, v);
  }
  return normalize(d);
}

/// Steps of a packed normal's components: it only decides which surface a photon lies on.
inline constexpr float kNormalSteps = 127.0f;

/// Normal in three signed bytes.
[[nodiscard]] inline std::uint32_t pack_normal(const Vec3f& n) {
  const auto byte = [](float x) {
    return static_cast<std::uint32_t>(
        static_cast<std::uint8_t>(static_cast<std::int8_t>(std::lrint(x * kNormalSteps))));
  };
  return byte(n.x) | (byte(n.y) << 8) | (byte(n.z) << 16);
}

/// A photon where it was stored, half a cache line.
struct alignas(32) Photon {
  Vec3f position;           ///< [m]
  Rgb flux;                 ///< in units of the mean flux of an emitted path (PhotonTracer)
  std::uint32_t direction;  ///< packed, towards where the photon came from
  std::uint32_t normal;     ///< packed geometric normal, on the side that the photon came from

  friend bool operator==(const Photon&, const Photon&) = default;
};
using Photons = std::vector<Photon>;

[[nodiscard]] inline Photon make_photon(const Vec3f& position, const Rgb& flux, const Vec3f& towards_light,
                                        const Vec3f& surface_normal) {
  return {position, flux, pack_direction(towards_light), pack_normal(surface_normal)};
}

}  // namespace pf
