#pragma once

#include "common/math/philox.h"
#include "worker/photon/photon.h"

namespace pf {

/// So many photons on a floor of 1 m^2, as dense everywhere: what a query costs then depends on the tree alone.
inline Photons floor_of_photons(int count) {
  PathRng rng(1, Stream::kTest, 0, 0);
  Photons photons;
  for (int i = 0; i < count; ++i) {
    const Vec2f p = rng.next2();
    photons.push_back(make_photon({p.x, 0.0f, p.y}, {1.0f, 0.5f, 0.25f}, {0, 1, 0}, {0, 1, 0}));
  }
  return photons;
}

}  // namespace pf
