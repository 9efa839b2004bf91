#include "worker/integrators/photon_map.h"

#include <algorithm>

#include "worker/photon/covered_area.h"

namespace pf {

/// Keeps the discs of one pixel's first sample.
struct CoveredRadii::Sink {
  std::vector<GatherDisc>& discs;
  TileFigures& figures;
  float radius;

  void ray() { ++figures.rays; }
  void escape(const EyeWalk&) {}
  void emitter(const SurfacePoint&, const Vec3f&, const EyeWalk&) {}
  void first_hit(const Vertex&, float) {}
  void direct(const Vertex&, float, const Vec2f&, float, const EyeWalk&) {}
  void gather(const Vertex& vertex, const Rgb&, const Vec2f& u, const EyeWalk&) {
    discs.push_back({vertex.point, disc_at(vertex, radius), u});
  }
};

void CoveredRadii::find(const ImagePart& part, float radius) {
  const std::lock_guard lock(finding_);
  if (radii_.empty())
    radii_.assign(static_cast<std::size_t>(eye_.width()) * static_cast<std::size_t>(eye_.height()), -1.0f);
  if (at(part.x0, part.y0) >= 0.0f) return;
  Statistics unused;
  for_each_tile(Tile{part.x0, part.y0, part.x1, part.y1}, unused, [&](const Tile& tile, TileFigures& figures) {
    std::vector<GatherDisc> discs;
    std::vector<std::size_t> pixels;  // of the discs
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) {
        radii_[index(x, y)] = kInfinity;
        Sink sink{discs, figures, radius};
        EyePaths(scene_, eye_, max_depth_).follow(x, y, 0, sink);
        // A pixel that met nothing now may meet an edge later.
        if (discs.size() == pixels.size()) radii_[index(x, y)] = 0.0f;
        pixels.resize(discs.size(), index(x, y));
      }
    }
    find_covered_radii(scene_, discs, figures.rays);
    for (std::size_t d = 0; d < discs.size(); ++d)
      radii_[pixels[d]] = std::min(radii_[pixels[d]], discs[d].covered_radius);
  });
}

PhotonMapIntegrator::PhotonMapIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec)
    : SinglePassIntegrator(scene, camera, spec, Extra::kSpecular),
      show_map_(spec.photon_map.show_map),
      covered_(scene_, eye_, max_depth_) {
  const TracedPhotons global(scene, spec, TracedPhotons::Purpose::kGlobal, spec.integrator.max_depth);
  const Photons& indirect = global.batch.flows[kIndirect];
  std::vector<const Photons*> shown{&indirect};
  if (show_map_) shown = {&global.batch.direct, &global.batch.flows[kCaustic], &indirect};
  global_ = MapEstimate(scene, shown, global.flux_unit, global_options(spec));
  photon_figures_ = global.figures();
  if (show_map_) return;
  const TracedPhotons caustics(scene, spec, TracedPhotons::Purpose::kCaustics, spec.integrator.max_depth);
  const Photons* flows[] = {&caustics.batch.flows[kCaustic]};
  caustics_ = MapEstimate(scene, flows, caustics.flux_unit, caustic_options(spec));
  photon_figures_ += caustics.figures();
}

void PhotonMapIntegrator::prepare(const ImagePart& part) const {
  covered_.find(part, std::max(global_.max_distance(), caustics_.max_distance()));
}

/// Adds what the maps hold at the end of an eye path.
struct PhotonMapIntegrator::Gather {
  const PhotonMapIntegrator& integrator;
  TileFigures& figures;
  float covered;

  template <typename Layers>
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk&, const Layers& to) {
    const auto light = [&](const MapEstimate& map) {
      return beta * map.radiance(integrator.scene_, vertex, Portion::kGather, covered, u, figures);
    };
    to.add_flow(kIndirect, light(integrator.global_));
    to.add_flow(kCaustic, light(integrator.caustics_));
  }
};

/// Shows the map and nothing else.
struct PhotonMapIntegrator::ShowMapSink {
  const PhotonMapIntegrator& integrator;
  const PixelTarget& target;
  float covered;

  void ray() { ++target.figures.rays; }
  void escape(const EyeWalk&) {}
  void emitter(const SurfacePoint&, const Vec3f&, const EyeWalk&) {}
  void first_hit(const Vertex& vertex, float distance) {
    if (target.features != nullptr) add_features(*target.features, integrator.film_.scale, vertex, distance);
  }
  void direct(const Vertex&, float, const Vec2f&, float, const EyeWalk&) {}
  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f& u, const EyeWalk&) {
    target.tally.add_flow(kIndirect, beta * integrator.global_.radiance(integrator.scene_, vertex, Portion::kGather,
                                                                        covered, u, target.figures));
  }
};

void PhotonMapIntegrator::render(const PixelTarget& target) const {
  if (target.x == 0 && target.y == 0 && target.sample == 0) target.figures += photon_figures_;
  const EyePaths paths(scene_, eye_, max_depth_);
  const float covered = covered_.at(target.x, target.y);
  if (show_map_) {
    ShowMapSink sink{*this, target, covered};
    paths.follow(target.x, target.y, target.sample, sink);
    return;
  }
  Gather method{*this, target.figures, covered};
  FourPartSink<Gather> sink(scene_, film_.scale, light_samples_, target, method);
  paths.follow(target.x, target.y, target.sample, sink);
}

}  // namespace pf
