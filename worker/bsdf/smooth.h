#pragma once

#include <optional>

#include "worker/bsdf/bsdf.h"

namespace pf {

/// A material that only mirrors and refracts sharply: polished metal, clear glass, a clean sheet. Nothing of
/// it is matte, rough, coated or textured.
class SmoothMaterial {
 public:
  /// Empty for any other material. `p` holds for every point of it; normals and eta_outside are not read.
  [[nodiscard]] static std::optional<SmoothMaterial> of(const SurfaceParams& p);

  /// The boundary as met from the front or from the back; `room` is used where it has to be made. Null where
  /// it lets light go straight on into a medium of equal index: that is left to Bsdf.
  [[nodiscard]] const Interface* boundary(float eta_outside, bool front, std::optional<Interface>& room) const {
    const std::optional<Interface>& in_air = front ? front_ : back_;
    if (eta_outside != 1.0f) room = make(eta_outside, front);
    const std::optional<Interface>& met = eta_outside == 1.0f ? in_air : room;
    return met ? &*met : nullptr;
  }

 private:
  explicit SmoothMaterial(const SurfaceParams& p);
  [[nodiscard]] std::optional<Interface> make(float eta_outside, bool front) const;

  SurfaceParams params_;
  std::optional<Interface> front_, back_;  ///< in air, where nearly all of them are
};

}  // namespace pf
