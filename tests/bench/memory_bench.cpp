// The hot loops against the memory's bandwidth, each on one thread, with a triad measured in the same run. Run:
// pf_memory_bench.
//
// A loop that reaches most of the triad's rate can only become faster by touching fewer bytes; one far below it waits
// for instructions or for the latency of scattered reads. Photon tracing is also set against bare Embree rays, by
// pf_photon_bench.

#include <vector>

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include "common/film/film.h"
#include "common/math/philox.h"
#include "common/wire/statistics_codec.h"
#include "tests/bench/bandwidth.h"
#include "tests/bench/floor_of_photons.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"
#include "worker/photon/photon_rays.h"
#include "worker/photon/photon_tracer.h"
#include "worker/photon/photon_tree.h"
#include "worker/photon/sample_tree.h"

namespace pf {
namespace {

constexpr int kPhotons = 1000000;
constexpr std::uint32_t kPaths = 65536;
constexpr int kEdge = 512;

using Limit = tbb::global_control;
constexpr auto kThreads = Limit::max_allowed_parallelism;

const Scene& box() {
  static const auto scene = test::peer_box(64).build();
  return *scene;
}

/// Bytes: photons stored, 32 each.
void trace_photons(benchmark::State& state) {
  const Limit one(kThreads, 1);
  const PhotonTracer tracer(box(), {1, kPaths, 0});
  const Bandwidth bandwidth;
  std::uint64_t sub_pass = 0;
  double bytes = 0;
  for (auto _ : state) {
    const PhotonBatch batch = tracer.trace(sub_pass++);
    for (const Photons& flow : batch.flows) bytes += 32.0 * static_cast<double>(flow.size());
  }
  bandwidth.report(state, bytes);
}
BENCHMARK(trace_photons)->Unit(benchmark::kMillisecond);

/// Bytes: photons read once and written once.
void build_tree(benchmark::State& state) {
  const Limit one(kThreads, 1);
  const Photons photons = floor_of_photons(kPhotons);
  const Bandwidth bandwidth;
  for (auto _ : state) {
    const PhotonTree tree{Photons(photons)};
    benchmark::DoNotOptimize(tree.size());
  }
  bandwidth.report(state, 64.0 * kPhotons * static_cast<double>(state.iterations()));
}
BENCHMARK(build_tree)->Unit(benchmark::kMillisecond);

/// A million queries of about so many photons, neighbours one after the other as an image asks them. Bytes: photons
/// found, 32 each, whichever cache they come from.
void gather(benchmark::State& state) {
  static const PhotonTree tree(floor_of_photons(kPhotons));
  const float radius2 = static_cast<float>(state.range(0)) / (kPi * kPhotons);
  const Bandwidth bandwidth;
  double found = 0;
  for (auto _ : state) {
    for (int y = 0; y < 1000; ++y) {
      for (int x = 0; x < 1000; ++x) {
        const Vec3f at{(static_cast<float>(x) + 0.5f) * 1e-3f, 0.0f, (static_cast<float>(y) + 0.5f) * 1e-3f};
        found += tree.sum_flux({at, {0, 1, 0}, radius2, false}).count;
      }
    }
  }
  bandwidth.report(state, 32.0 * found);
  state.counters["photons/query"] = found / (1e6 * static_cast<double>(state.iterations()));
}
BENCHMARK(gather)->Arg(10)->Arg(50)->Arg(500)->Unit(benchmark::kMillisecond);

/// Photon rays on the samples of a floor. Bytes: samples met, read and written.
void splat(benchmark::State& state) {
  std::vector<SplatSample> samples;
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 256; ++x) {
      SplatSample s;
      s.position = {(static_cast<float>(x) + 0.5f) / 256 - 0.5f, 0.0f, 0.5f - (static_cast<float>(y) + 0.5f) / 256};
      s.ng = s.ns = {0, 1, 0};
      s.id = static_cast<std::uint32_t>(samples.size());
      samples.push_back(s);
    }
  }
  const SampleTree tree(std::move(samples));
  const PhotonRays rays(box(), {1, 20000, 0}, true);
  std::vector<PhotonSegment> segments;
  PhotonRays::Figures figures;
  rays.trace(0, 0, 20000, segments, figures);
  std::vector<RayKernel> kernels;
  for (const PhotonSegment& s : segments) {
    const Frame frame = Frame::from_normal(s.direction);
    kernels.emplace_back(s.origin, s.direction, s.length, frame.t, frame.b, Spread{4e-4f, 0.0f, 4e-4f}, Spread{},
                         Spread{}, s.start, s.end);
  }
  const Bandwidth bandwidth;
  double met = 0, sum = 0;
  for (auto _ : state) {
    for (const RayKernel& kernel : kernels) {
      tree.for_each(kernel, [&](std::size_t, const RayKernel::Meeting& meeting) {
        met += 1;
        sum += double{meeting.area};
      });
    }
  }
  benchmark::DoNotOptimize(sum);
  bandwidth.report(state, 2.0 * sizeof(SplatSample) * met);
  state.counters["Mrays/s"] =
      benchmark::Counter(1e-6 * static_cast<double>(kernels.size()), benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(splat)->Unit(benchmark::kMillisecond);

Statistics unit_of(std::uint64_t first) {
  const JobSpec spec = test::job(kEdge, kEdge, IntegratorType::kSppm, 100'000);
  const auto integrator = test::make_integrator(box(), spec);
  auto radii = integrator->initial_radii();
  Statistics sums(kEdge, kEdge, first < kFeatureSubPasses);
  integrator->run({first, 1}, radii, sums);
  return sums;
}

/// Bytes: both results read, one written.
void merge(benchmark::State& state) {
  const Statistics result = unit_of(100);
  Statistics into(kEdge, kEdge, false);
  const Bandwidth bandwidth;
  for (auto _ : state) {
    if (!into.add(result)) state.SkipWithError("overflow");
  }
  bandwidth.report(state, 3.0 * sizeof(PixelSums) * kEdge * kEdge * static_cast<double>(state.iterations()));
}
BENCHMARK(merge)->Unit(benchmark::kMillisecond);

/// Bytes: sums as they are in memory.
void compress(benchmark::State& state) {
  const Statistics result = unit_of(100);
  const Bandwidth bandwidth;
  double bytes = 0;
  for (auto _ : state) bytes += static_cast<double>(pack_statistics(result).raw_bytes);
  bandwidth.report(state, bytes);
}
BENCHMARK(compress)->Unit(benchmark::kMillisecond);

/// Bytes: the image's floats, before ZIP.
void write_exr_file(benchmark::State& state) {
  LayeredImage image{kEdge, kEdge, {}, {}};
  PathRng rng(1, Stream::kTest, 0, 0);
  for (const char* name : {"", "direct", "indirect"}) {
    Layer layer{name, {"R", "G", "B"}, {}};
    for (int i = 0; i < 3 * kEdge * kEdge; ++i) layer.data.push_back(rng.next1());
    image.layers.push_back(std::move(layer));
  }
  const TempFolder folder;
  const Bandwidth bandwidth;
  for (auto _ : state) {
    if (!write_exr(folder / "image.exr", image)) state.SkipWithError("not written");
  }
  bandwidth.report(state, 36.0 * kEdge * kEdge * static_cast<double>(state.iterations()));
}
BENCHMARK(write_exr_file)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace pf
