#pragma once

#include <atomic>
#include <mutex>
#include <vector>

#include "common/spec/job_spec.h"
#include "worker/integrators/map_estimate.h"
#include "worker/integrators/single_pass.h"

namespace pf {

/// Radii up to which discs around what the pixels' first samples meet lie on the surface whole, made by tiles
/// when a tile is about to be rendered. They depend on the pixel alone.
class CoveredRadii {
 public:
  CoveredRadii(const Scene& scene, const Eye& eye, int max_depth) : scene_(scene), eye_(eye), max_depth_(max_depth) {}
  /// Finds those of a part of the image, unless they are known; discs up to `radius` [m] count.
  void find(const ImagePart& part, float radius);
  /// Of a pixel in a part that was found [m].
  [[nodiscard]] float at(int x, int y) const { return radii_[index(x, y)]; }

 private:
  struct Sink;
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(eye_.width()) + static_cast<std::size_t>(x);
  }
  const Scene& scene_;
  const Eye& eye_;
  int max_depth_;
  std::mutex finding_;
  std::vector<float> radii_;  ///< negative: not yet found
};

/// Photon mapping with both maps seen directly.
///
/// Jensen 1996, "Global Illumination using Photon Maps"; Jensen 2001, "Realistic Image Synthesis Using Photon
/// Mapping". Radiance is split in four [Jensen 1996, 4]: direct light by next-event estimation from the eye,
/// specular by following sharp reflections and refractions, caustics from a caustic map of many photons shot
/// at what is specular, and indirect light from a global map, here estimated at the first surface that the
/// eye path gathers on (final_gather adds a bounce before it). With photon_map.show_map, the global map holds
/// direct light and caustics, too, and is all that is shown.
///
/// Biased: light is blurred over discs of the k nearest photons; the squared bias falls with the photons.
/// Where it fails: indirect light shows as low-frequency blotches, and corners of small objects as blur,
/// unless photons are very many.
class PhotonMapIntegrator final : public SinglePassIntegrator {
 public:
  PhotonMapIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec);

  [[nodiscard]] const MapEstimate& global_map() const { return global_; }
  [[nodiscard]] const MapEstimate& caustic_map() const { return caustics_; }

 protected:
  void render(const PixelTarget& target) const override;
  void prepare(const ImagePart& part) const override;

 private:
  struct Gather;
  struct ShowMapSink;

  bool show_map_;
  MapEstimate global_, caustics_;
  TileFigures photon_figures_;  ///< of the maps; counted with the first pixel's first sample
  mutable CoveredRadii covered_;
};

}  // namespace pf
