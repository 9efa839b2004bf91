#include "worker/integrators/path.h"

#include <algorithm>

#include "worker/integrators/single_pass.h"

namespace pf {
namespace {

/// Which layer light belongs to, told by the path from the eye: rough counts the non-specular vertices so far.
enum class PathLayer { kDirect, kCaustic, kIndirect };

PathLayer layer_of(int rough, bool specular_since) {
  if (rough == 0 || (rough == 1 && !specular_since)) return PathLayer::kDirect;
  return rough == 1 ? PathLayer::kCaustic : PathLayer::kIndirect;
}

void add(Tally& tally, PathLayer layer, const Rgb& radiance) {
  if (layer == PathLayer::kDirect) {
    tally.add_direct(radiance);
  } else {
    tally.add_flow(layer == PathLayer::kCaustic ? kCaustic : kIndirect, radiance);
  }
}

}  // namespace

PathIntegrator::PathIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec)
    : scene_(scene),
      eye_(scene, camera, spec.image.width, spec.image.height, spec.integrator.seed),
      film_(film_of_samples(scene, spec, Extra::kNone)),
      max_depth_(spec.integrator.max_depth) {}

void PathIntegrator::run(const WorkUnit& unit, const std::vector<ProgressivePixel>&, Statistics& sums) const {
  for_each_pixel(eye_.width(), eye_.height(), sums, [&](int x, int y, TileFigures& figures) {
    const std::size_t i =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(eye_.width()) + static_cast<std::size_t>(x);
    for (std::uint64_t s = unit.first_sub_pass; s < unit.first_sub_pass + unit.sub_passes; ++s) {
      trace(x, y, s, sums.pixels[i], s < kFeatureSubPasses ? &sums.features[i] : nullptr, figures);
    }
  });
  sums.sub_passes += unit.sub_passes;
}

void PathIntegrator::trace(int x, int y, std::uint64_t sample, PixelSums& sums, FeatureSums* features,
                           TileFigures& figures) const {
  Eye::Start start = eye_.start(x, y, sample);
  PixelSequence& sequence = start.sequence;
  Ray ray = start.ray;
  MediumStack media = eye_.media();
  BsdfTechnique technique{.position = ray.origin};
  Tally tally(sums, nullptr, film_.scale, figures.faults);
  Rgb beta{1.0f, 1.0f, 1.0f};
  int rough = 0;
  bool specular_since = false;

  for (int bounce = 0;; ++bounce) {
    ++figures.rays;
    const auto hit = scene_.intersect(ray);
    if (!hit) {
      if (scene_.environment().present()) {
        const float weight = environment_weight(scene_, ray.direction, technique);
        add(tally, layer_of(rough, specular_since), beta * scene_.environment().radiance(ray.direction) * weight);
      }
      break;
    }
    if (!media.empty()) beta *= media.transmittance(scene_, length(hit->position - technique.position));
    const Vec3f wo = -ray.direction;
    if (scene_.emits(*hit)) {
      add(tally, layer_of(rough, specular_since),
          beta * scene_.emitted(*hit, wo) * emitter_weight(scene_, *hit, technique));
    }
    const Vertex vertex(scene_, *hit, wo, media);
    if (bounce == 0 && features != nullptr) add_features(*features, film_.scale, vertex, hit->t);
    if (vertex.bsdf.is_black() || (max_depth_ > 0 && bounce >= max_depth_)) break;

    // Next-event estimation.
    const float u_light = sequence.next1();
    const Vec2f u_point = sequence.next2();
    if (!vertex.bsdf.is_delta_only()) {
      const PathLayer layer = rough == 0 ? PathLayer::kDirect : PathLayer::kIndirect;
      add(tally, layer,
          beta * direct_light(scene_, vertex, media, u_light, u_point, Portion::kAll, 1.0f, figures.rays));
    }

    // Follow the BSDF.
    const float u_lobe = sequence.next1();
    const auto next = vertex.bsdf.sample(wo, u_lobe, sequence.next2(), Transport::kRadiance);
    if (!next) break;
    beta *= next->weight;
    technique = {next->delta, next->pdf_w, hit->position, vertex.bsdf.ns(), vertex.transmissive};
    if (next->specularity > 0.5f) {
      specular_since = true;
    } else {
      ++rough;
      specular_since = false;
    }
    if (next->refracted) media.cross(hit->material, vertex.entering());
    ray = {offset_past(*hit, next->wi), next->wi};

    // Russian roulette after a few bounces, when the path carries little.
    constexpr int kFirstRoulette = 4;
    constexpr float kMaxSurvival = 0.95f;  // ends paths caught between perfect mirrors
    if (bounce >= kFirstRoulette) {
      const float survival = std::min(kMaxSurvival, max_component(beta));
      if (!(survival > 0.0f) || sequence.next1() >= survival) break;
      beta /= survival;
    }
  }
  tally.commit();
}

}  // namespace pf
