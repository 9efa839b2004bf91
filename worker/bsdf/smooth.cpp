#include "worker/bsdf/smooth.h"

#include <algorithm>

namespace pf {

std::optional<BsdfSample> SmoothSurface::sample_flux(float u_lobe) const {
  if (!seen_ || !boundary_.present()) return std::nullopt;
  Vec3f wo = mirror_.to_local(wo_);
  wo.z = std::clamp(wo.z, 1e-9f, 1.0f);
  const Interface::Split split = boundary_.split(wo.z);
  // The only lobe: chosen with probability 1, or 0 where it has no albedo.
  if (!(average(split.reflected + split.transmitted) > 0.0f)) return std::nullopt;
  const auto drawn = boundary_.sample_about({0.0f, 0.0f, 1.0f}, wo, wo.z, split, u_lobe);
  if (!drawn) return std::nullopt;
  const bool straight = drawn->transmitted && boundary_.through == Interface::Through::kThin;
  const Vec3f wi = straight ? -wo_ : normalize(mirror_.to_world(drawn->wi));
  return delta_sample({wi, drawn->weight, drawn->transmitted, thin_}, {wo_, ng_, mirror_.n}, true);
}

}  // namespace pf
