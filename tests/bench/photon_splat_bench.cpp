// Photon ray splatting against a plain disc estimate of photon hits at edges, photon differentials against none on the
// caustic of a metal ring, and the speed of splatting. Run: pf_photon_splat_bench.

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include "common/film/metrics.h"
#include "tests/bench/thread_time.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/integrators/photon_splat.h"
#include "worker/integrators/sppm.h"
#include "worker/photon/photon_rays.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/photon_tree.h"
#include "worker/photon/sample_tree.h"

namespace pf {
namespace {

constexpr std::uint32_t kPaths = 200000;
constexpr int kSubPasses = 10;

/// Irradiance at points of one plane, by both estimates with kernels of one radius.
struct Irradiance {
  std::vector<double> splat, disc;
};

/// Every kernel is a circle of this radius.
RayKernel circle_of(const PhotonSegment& s, float radius) {
  const Frame frame = Frame::from_normal(s.direction);
  return RayKernel(s.origin, s.direction, s.length, frame.t, frame.b, {radius * radius, 0.0f, radius * radius}, {}, {},
                   s.start, s.end);
}

Irradiance irradiance_at(const Scene& scene, const std::vector<Vec3f>& points, const Vec3f& normal, float radius) {
  std::vector<SplatSample> samples;
  for (const Vec3f& p : points) {
    SplatSample s;
    s.position = p;
    s.ng = s.ns = normal;
    s.id = static_cast<std::uint32_t>(samples.size());
    samples.push_back(s);
  }
  const SampleTree tree(std::move(samples));
  const PhotonOptions options{1, kPaths, 0};
  const PhotonRays rays(scene, options, true);
  const PhotonTracer tracer(scene, options);
  Irradiance found{std::vector<double>(points.size()), std::vector<double>(points.size())};
  for (int sub_pass = 0; sub_pass < kSubPasses; ++sub_pass) {
    std::vector<PhotonSegment> segments;
    PhotonRays::Figures figures;
    rays.trace(static_cast<std::uint64_t>(sub_pass), 0, kPaths, segments, figures);
    for (const PhotonSegment& segment : segments) {
      tree.for_each(circle_of(segment, radius), [&](std::size_t i, const RayKernel::Meeting& meeting) {
        // A uniform kernel, as the disc's.
        found.splat[tree.samples()[i].id] +=
            double{average(segment.flux)} * std::abs(dot(segment.direction, normal)) / double{meeting.area};
      });
    }
    PhotonBatch batch = tracer.trace(static_cast<std::uint64_t>(sub_pass));
    for (const Flow flow : {kCaustic, kIndirect}) {
      const PhotonTree photons(std::move(batch.flows[flow]));
      for (std::size_t i = 0; i < points.size(); ++i) {
        const FluxSum sum = photons.sum_flux({points[i], normal, radius * radius, false});
        const double steps = static_cast<double>(sum.steps[0] + sum.steps[1] + sum.steps[2]) / 3.0;
        found.disc[i] += steps * tracer.flux_unit() / kFluxSteps / (double{kPi} * radius * radius);
      }
    }
  }
  for (auto* estimate : {&found.splat, &found.disc}) {
    for (double& e : *estimate) e /= kSubPasses;
  }
  return found;
}

/// Mean estimate of rows of points at these distances from an edge, in radii, relative to the truth.
void report_by_distance(benchmark::State& state, const Scene& scene, const Vec3f& edge, const Vec3f& inwards,
                        const Vec3f& along, const Vec3f& normal, float radius, double truth) {
  const std::array distances{0.05f, 0.25f, 0.5f, 1.0f, 2.0f};
  constexpr int kRow = 100;
  std::vector<Vec3f> points;
  for (const float d : distances) {
    for (int i = 0; i < kRow; ++i)
      points.push_back(edge + inwards * (d * radius) + along * ((static_cast<float>(i) + 0.5f) / kRow));
  }
  for (auto _ : state) {
    const Irradiance found = irradiance_at(scene, points, normal, radius);
    for (std::size_t d = 0; d < distances.size(); ++d) {
      double splat = 0.0, disc = 0.0;
      for (std::size_t i = d * kRow; i < (d + 1) * kRow; ++i) {
        splat += found.splat[i] / kRow / truth;
        disc += found.disc[i] / kRow / truth;
      }
      const std::string at = std::to_string(distances[d]).substr(0, 4) + "R";
      state.counters["splat@" + at] = splat;
      state.counters["disc@" + at] = disc;
    }
  }
}

/// The edge of a wall that stands free: a strip of wall in parallel light that comes from a mirror.
void free_edge(benchmark::State& state) {
  test::SceneMaker maker;
  maker.quad({-2, 2, -2}, {4, 0, 0}, {0, 0, 4}, maker.mirror());
  maker.quad({-0.25f, 0, 0.75f}, {0.5f, 0, 0}, {0, 0, -1.5f}, maker.lambert({0.5f, 0.5f, 0.5f}));
  maker.directional_light({0, 1, 0}, 1.0f);
  // The light comes from below: the strip's own shadow on the mirror lies over the strip, so light comes in at a slant.
  maker.description.lights.back().direction = normalize(Vec3f(0.5f, 1, 0));
  const auto scene = maker.build();
  const double cosine = double{normalize(Vec3f(0.5f, 1, 0)).y};
  report_by_distance(state, *scene, {-0.25f, 0, -0.5f}, {1, 0, 0}, {0, 0, 1}, {0, 1, 0}, 0.05f, cosine);
}
BENCHMARK(free_edge)->Iterations(1)->Unit(benchmark::kMillisecond);

/// The foot of a wall: a floor's edge where a wall begins, in a closed room where irradiance is uniform.
void foot_of_a_wall(benchmark::State& state) {
  test::SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.emitter({1, 1, 1}, {0.5f, 0.5f, 0.5f}), true);
  const auto scene = maker.build();
  report_by_distance(state, *scene, {-1, -1, -0.5f}, {1, 0, 0}, {0, 0, 1}, {0, 1, 0}, 0.05f, double{kPi});
}
BENCHMARK(foot_of_a_wall)->Iterations(1)->Unit(benchmark::kMillisecond);

/// A polished ring on a floor with a lamp above its rim; the camera sees the floor inside, lit by the ring's caustic.
std::unique_ptr<const Scene> ring_scene() {
  test::SceneMaker maker;
  maker.quad({-2, 0, 2}, {4, 0, 0}, {0, 0, -4}, maker.lambert({0.7f, 0.7f, 0.7f}));
  Mesh ring;
  ring.material = maker.metal({1.0f, 0.8f, 0.4f}, 0.0f);
  constexpr std::uint32_t kSegments = 256;
  for (std::uint32_t i = 0; i <= kSegments; ++i) {
    const float phi = 2.0f * kPi * static_cast<float>(i) / kSegments;
    const Vec3f out{std::cos(phi), 0.0f, std::sin(phi)};
    for (const float y : {0.0f, 0.4f}) {
      ring.positions.push_back(out + Vec3f(0, y, 0));
      ring.normals.push_back(-out);
    }
    const std::uint32_t k = 2 * i;
    if (i < kSegments) ring.triangles.insert(ring.triangles.end(), {{k, k + 1, k + 2}, {k + 1, k + 3, k + 2}});
  }
  MeshInstance instance;
  instance.mesh = static_cast<int>(maker.description.meshes.size());
  maker.description.meshes.push_back(ring);
  maker.description.instances.push_back(instance);
  maker.sphere({0.9f, 0.9f, 0.0f}, 0.03f, maker.emitter({200, 200, 200}), 8);
  maker.orthographic_camera({0, 0.8f, 0}, {0, 0, 0}, 0.65f, 0.65f);
  return maker.build();
}

/// Error of the caustic layer against SPPM, and what of it is blur: the error that is left after many sub-passes.
void ring_caustic(benchmark::State& state) {
  static const auto scene = ring_scene();
  JobSpec spec = test::job(128, 128, IntegratorType::kSppm, 500000);
  static const std::vector<Rgb> reference =
      test::layer_of(test::render(SppmIntegrator(*scene, scene->cameras().front(), spec), 40), "caustics");
  spec = test::job(128, 128, IntegratorType::kPhotonSplat, 50000);
  spec.photon_splat.differentials = state.range(0) != 0;
  const PhotonSplatIntegrator splat(*scene, scene->cameras().front(), spec);
  for (auto _ : state) {
    for (const std::uint64_t passes : {2, 32}) {
      const auto image = test::layer_of(test::render(splat, passes), "caustics");
      state.counters["relMSE of " + std::to_string(passes)] = compare_pixels(image, reference).relative_mse;
    }
  }
}
BENCHMARK(ring_caustic)->ArgName("differentials")->Arg(0)->Arg(1)->Iterations(1)->Unit(benchmark::kMillisecond);

/// Sub-passes of the peers' box on one thread, by its CPU time.
void splat_speed(benchmark::State& state) {
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  static const auto scene = test::peer_box(64).build();
  const PhotonSplatIntegrator integrator(*scene, scene->cameras().front(),
                                         test::job(256, 256, IntegratorType::kPhotonSplat, 100000));
  std::uint64_t pass = 0;
  Statistics sums(256, 256, true, true);
  for (auto _ : state) {
    const double start = thread_seconds();
    integrator.run({pass++, 1}, {}, sums);
    state.SetIterationTime(thread_seconds() - start);
  }
  state.counters["rays splatted"] = static_cast<double>(sums.photons_stored) / static_cast<double>(pass);
}
BENCHMARK(splat_speed)->Iterations(4)->UseManualTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace pf
