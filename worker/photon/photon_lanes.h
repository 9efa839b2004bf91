#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "worker/photon/photon.h"
#include "worker/photon/photon_numbers.h"
#include "worker/scene/medium_stack.h"
#include "worker/scene/surface_lanes.h"

namespace pf {

/// Eight photons on their way, side by side.
struct PhotonLanes {
  RayLanes ray;
  Vec3x8 position;  ///< of the lamp or of the last surface
  Vec3x8 flux;      ///< in PhotonTracer::flux_unit()
  Uint8 path;
  Int8 bounce;
  Int8 specular_only;  ///< all ones: no diffuse bounce yet
  std::array<MediumStack, kLanes> media;
};

/// One of them by itself.
struct WalkingPhoton {
  Ray ray;
  Vec3f position;
  Rgb flux;
  std::uint32_t path;
  int bounce;
  bool specular_only;
  MediumStack media;
};

/// make_photon() of eight photons.
[[nodiscard]] inline std::array<Photon, kLanes> make_photons(const Vec3x8& position, const Vec3x8& flux,
                                                             const Vec3x8& towards_light,
                                                             const Vec3x8& surface_normal) {
  const Vec3x8& d = towards_light;
  const Float8 scale = 1.0f / (abs(d.x) + abs(d.y) + abs(d.z));
  const Float8 u = d.x * scale, v = d.y * scale;
  const Int8 below = d.z < 0.0f;
  const Float8 folded_u = (1.0f - abs(v)) * with_sign(all(1.0f), u),
               folded_v = (1.0f - abs(u)) * with_sign(all(1.0f), v);
  const auto quantise = [](const Float8& x) { return round_to_int((x * 0.5f + 0.5f) * 65535.0f); };
  const Uint8 direction = quantise(below ? folded_u : u) | (quantise(below ? folded_v : v) << 16);
  const auto byte = [](const Float8& x) { return round_to_int(x * kNormalSteps) & 0xFFu; };
  const Uint8 normal = byte(surface_normal.x) | (byte(surface_normal.y) << 8) | (byte(surface_normal.z) << 16);
  std::array<Float8, kLanes> rows{position.x,
                                  position.y,
                                  position.z,
                                  flux.x,
                                  flux.y,
                                  flux.z,
                                  reinterpret_cast<Float8>(direction),
                                  reinterpret_cast<Float8>(normal)};
  static_assert(sizeof(Photon) == sizeof(Float8) && offsetof(Photon, flux) == 12 && offsetof(Photon, direction) == 24);
  transpose(rows);
  std::array<Photon, kLanes> photons;
  for (std::size_t i = 0; i < rows.size(); ++i) _mm256_store_ps(&photons[i].position.x, rows[i]);
  return photons;
}

}  // namespace pf
