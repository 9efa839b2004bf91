#include "worker/bsdf/coat.h"

#include "worker/bsdf/albedo_table.h"
#include "worker/bsdf/fresnel.h"

namespace pf {

float Coat::reflectance(float cosine) const { return kF0 + (1.0f - kF0) * schlick_weight(cosine); }

float Coat::albedo(float cosine) const {
  if (alpha == 0.0f) return reflectance(cosine);
  const GgxAlbedo& e = GgxAlbedo::get();
  return kF0 * e.f0.at(cosine, roughness) + e.f90.at(cosine, roughness);
}

}  // namespace pf
