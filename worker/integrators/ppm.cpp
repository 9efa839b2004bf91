#include "worker/integrators/ppm.h"

#include <algorithm>
#include <atomic>

#include "worker/integrators/eye_paths.h"

namespace pf {
namespace {

/// Counts the hit points of a pixel.
struct CountingSink {
  int gathers = 0;
  void ray() {}
  void escape(const EyeWalk&) {}
  void emitter(const SurfacePoint&, const Vec3f&, const EyeWalk&) {}
  void first_hit(const Vertex&, float) {}
  void direct(const Vertex&, float, const Vec2f&, float, const EyeWalk&) {}
  void gather(const Vertex&, const Rgb&, const Vec2f&, const EyeWalk&) { ++gathers; }
};

/// Hit points of the pixel that has most, at most those that the job allows.
int most_hit_points(const Scene& scene, const Camera& camera, const JobSpec& spec) {
  const Eye eye(scene, camera, spec.image.width, spec.image.height, spec.integrator.seed);
  const EyePaths paths(scene, eye, spec.integrator.max_depth);
  std::atomic<int> most{1};
  Statistics figures;
  for_each_pixel(eye.width(), eye.height(), figures, [&](int x, int y, TileFigures&) {
    CountingSink sink;
    for (int sample = 0; sample < spec.ppm.eye_samples; ++sample)
      paths.follow(x, y, static_cast<std::uint64_t>(sample), sink);
    int known = most.load();
    while (known < sink.gathers && !most.compare_exchange_weak(known, sink.gathers)) {
    }
  });
  return std::min(most.load(), spec.ppm.hit_points);
}

}  // namespace

PpmIntegrator::PpmIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec, EmissionGuide guide)
    : ProgressiveMapping(
          scene, camera, spec,
          EyeSampling{static_cast<std::uint64_t>(spec.ppm.eye_samples), most_hit_points(scene, camera, spec)},
          std::move(guide)) {}

}  // namespace pf
