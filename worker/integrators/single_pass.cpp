#include "worker/integrators/single_pass.h"

#include <algorithm>

namespace pf {

FilmOptions film_of_samples(const Scene& scene, const JobSpec& spec, Extra extra) {
  FilmOptions film;
  film.width = spec.image.width;
  film.height = spec.image.height;
  film.estimator = Estimator::kPath;
  film.scale = scale_of_scene(scene, 0.0);
  film.extra = extra;
  return film;
}

SinglePassIntegrator::SinglePassIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec, Extra extra)
    : scene_(scene),
      eye_(scene, camera, spec.image.width, spec.image.height, spec.integrator.seed),
      film_(film_of_samples(scene, spec, extra)),
      max_depth_(spec.integrator.max_depth),
      light_samples_(std::max(1, spec.integrator.light_samples)) {
  film_.part_edge = PassOrder::edge_for(spec.image.width, spec.image.height);
}

void SinglePassIntegrator::run(const WorkUnit& unit, const std::vector<ProgressivePixel>&, Statistics& sums) const {
  const PassOrder order(film_);
  for (std::uint64_t s = unit.first_sub_pass; s < unit.first_sub_pass + unit.sub_passes; ++s) {
    const ImagePart part = order.part(s);
    prepare(part);
    for_each_tile(Tile{part.x0, part.y0, part.x1, part.y1}, sums, [&](const Tile& tile, TileFigures& figures) {
      for (int y = tile.y0; y < tile.y1; ++y) {
        for (int x = tile.x0; x < tile.x1; ++x) {
          const std::size_t i =
              static_cast<std::size_t>(y) * static_cast<std::size_t>(film_.width) + static_cast<std::size_t>(x);
          Tally tally(sums.pixels[i], &sums.extras[i], film_.scale, figures.faults);
          render({x, y, part.sample, tally, part.sample < kFeatureSubPasses ? &sums.features[i] : nullptr, figures});
          tally.commit();
        }
      }
    });
    ++sums.sub_passes;
  }
}

}  // namespace pf
