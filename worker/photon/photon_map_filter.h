#pragma once

#include <cstddef>

#include "common/math/vec.h"
#include "common/spec/job_spec.h"
#include "worker/photon/photon_map.h"

namespace pf {

/// Weight of a photon by its distance from the middle of the disc that is searched. With f(u) the weight at
/// distance u of the radius, an estimate sums f * flux / (pi r^2); f is scaled such that 2 * integral of f(u)
/// u du over [0, 1] is 1, and evenly spread photons give their density.
///
///   disc      f = 1
///   cone      f = (1 - u/k) / (1 - 2/(3k)), k = 1.1                     [Jensen 2001, 7.2.1, (7.8)]
///   Gaussian  f = w / 0.531..., w = a (1 - (1 - e^(-b u^2 / 2)) / (1 - e^-b)), a = 0.918, b = 1.953
///             [Jensen 2001, 7.2.2, (7.9); from Pavicic 1990]
///
/// Jensen takes the Gaussian's w to be normalised. It is for Pavicic's pixel filter; over the disc its mean
/// is 0.531, and an estimate by w alone would lose almost half of the light: it is divided by its mean here.
class MapFilter {
 public:
  explicit MapFilter(PhotonFilter filter) : filter_(filter) {}

  /// f at squared distance `u2` of the squared radius, in [0, 1].
  [[nodiscard]] float weight(float u2) const;
  /// Irradiance [flux of the map's photons per m^2] on the query's surface.
  [[nodiscard]] Rgb irradiance(const PhotonMap& map, const NearestPhotons& found) const;
  /// Sum over the photons of f * flux * scatter(direction the photon came from) / (pi r^2): what a surface
  /// scatters.
  template <typename Scatter>
  [[nodiscard]] Rgb scattered(const PhotonMap& map, const NearestPhotons& found, const Scatter& scatter) const {
    Rgb sum{0.0f, 0.0f, 0.0f};
    const float inverse = 1.0f / found.radius2;
    for (std::size_t i = 0; i < found.count; ++i) {
      const StoredPhoton& photon = map.photon(found.index[i]);
      sum += scatter(towards_light(photon)) * unpack_rgbe(photon.flux) * weight(found.distance2[i] * inverse);
    }
    return found.count == 0 ? sum : sum * (kInvPi * inverse);
  }

 private:
  PhotonFilter filter_;
};

}  // namespace pf
