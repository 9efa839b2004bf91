// Results of real sub-passes on their way: packing, unpacking into a film's sums, and the coordinator's whole way from
// chunk to sums, spool file and hashes included; all on one core. MB/s are of the sums in memory (88 bytes a pixel, 104
// with features). Run: pf_wire_bench.

#include <benchmark/benchmark.h>

#include "common/base/hash.h"
#include "common/wire/statistics_codec.h"
#include "coordinator/result_intake.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

constexpr int kEdge = 512;

/// What a unit of `sub_passes` of SPPM (500,000 photons each) or of path tracing sums up to. Sub-passes above
/// kFeatureSubPasses leave no features.
Statistics unit(IntegratorType type, std::uint64_t first, std::uint64_t sub_passes) {
  static const auto scene = test::peer_box(32).build();
  const JobSpec spec = test::job(kEdge, kEdge, type, 500'000);
  const auto integrator = test::make_integrator(*scene, spec);
  auto radii = integrator->initial_radii();
  Statistics sums(kEdge, kEdge, first < kFeatureSubPasses);
  integrator->run({first, sub_passes}, radii, sums);
  return sums;
}

const Statistics& results(std::int64_t index) {
  static const Statistics sppm_1 = unit(IntegratorType::kSppm, 0, 1);
  static const Statistics sppm_16 = unit(IntegratorType::kSppm, 100, 16);
  static const Statistics path_16 = unit(IntegratorType::kPath, 100, 16);
  return index == 0 ? sppm_1 : index == 1 ? sppm_16 : path_16;
}

void name(benchmark::State& state) {
  constexpr const char* kNames[] = {"SPPM, sub-pass 0 with features", "SPPM, 16 sub-passes", "path, 16 sub-passes"};
  state.SetLabel(kNames[state.range(0)]);
}

void pack(benchmark::State& state) {
  name(state);
  const Statistics& sums = results(state.range(0));
  std::size_t bytes = 0;
  std::size_t raw = 0;
  std::size_t chunks = 0;
  for (auto _ : state) {
    const PackedStatistics packed = pack_statistics(sums);
    bytes = 0;
    for (const std::string& chunk : packed.chunks) bytes += chunk.size();
    chunks = packed.chunks.size();
    raw = packed.raw_bytes;
  }
  const auto pixels = static_cast<double>(sums.pixels.size());
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * raw));
  state.counters["bytes_per_pixel"] = static_cast<double>(bytes) / pixels;
  state.counters["chunks"] = static_cast<double>(chunks);
}
BENCHMARK(pack)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);

/// Adds the result and takes it off again in turns, so that the sums never grow; both cost the same.
void unpack_and_add(benchmark::State& state) {
  name(state);
  const Statistics& sums = results(state.range(0));
  const PackedStatistics packed = pack_statistics(sums);
  Statistics into(sums.width, sums.height);
  for (auto _ : state) {
    StatisticsUnpacker unpacker(into);
    for (const std::string& chunk : packed.chunks) {
      if (!unpacker.add(chunk)) state.SkipWithError("a chunk was refused");
    }
    benchmark::DoNotOptimize(unpacker.content());
    state.PauseTiming();
    for (const std::string& chunk : packed.chunks) {
      if (!unpacker.take_off(chunk)) state.SkipWithError("a chunk was not taken off");
    }
    state.ResumeTiming();
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * packed.raw_bytes));
}
BENCHMARK(unpack_and_add)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);

/// As FarmJob takes a result in: every chunk is hashed and spooled as it comes; once all are here they are read back
/// and added.
void take_in(benchmark::State& state) {
  name(state);
  const Statistics& sums = results(state.range(0));
  const PackedStatistics packed = pack_statistics(sums);
  wire::ResultManifest manifest;
  for (const std::string& chunk : packed.chunks) manifest.add_chunk_xxh3(xxh3_64(std::string_view(chunk)));
  const TempFolder folder;
  Statistics into(sums.width, sums.height);
  for (auto _ : state) {
    auto intake = ResultIntake::open(folder / "incoming", manifest);
    if (!intake) {
      state.SkipWithError("no spool file");
      break;
    }
    for (std::size_t i = 0; i < packed.chunks.size(); ++i) {
      const auto kept = intake->put(static_cast<std::uint32_t>(i), packed.chunks[i]);
      if (!kept || !*kept) state.SkipWithError("a chunk was dropped");
    }
    StatisticsUnpacker unpacker(into);
    for (std::size_t i = 0; i < packed.chunks.size(); ++i) {
      const auto chunk = intake->read(i);
      if (!chunk || !unpacker.add(*chunk)) state.SkipWithError("a chunk was refused");
    }
    benchmark::DoNotOptimize(unpacker.content());
    state.PauseTiming();
    for (const std::string& chunk : packed.chunks) {
      if (!unpacker.take_off(chunk)) state.SkipWithError("a chunk was not taken off");
    }
    state.ResumeTiming();
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * packed.raw_bytes));
}
BENCHMARK(take_in)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace pf
