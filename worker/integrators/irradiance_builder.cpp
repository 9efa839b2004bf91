#include "worker/integrators/irradiance_builder.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "common/base/parallel.h"
#include "common/math/offset.h"
#include "worker/integrators/eye_paths.h"

namespace pf {
namespace {

/// The overture asks for records within this part of the accepted error, so that what it leaves overlaps: the mean over
/// several records has less noise than each.
constexpr float kOvertureTightness = 0.6f;
/// Pixels between the points of the lattice whose records get as many rays as the job asks for, and the least and
/// greatest part of them that others get. The noise of an image is least when a record's rays go by the root of the
/// area that it serves.
constexpr double kUsualStep = 16.0;
constexpr double kLeastPart = 1.0 / 8.0, kMostPart = 8.0;
/// Eye samples of a pixel that the overture looks at.
constexpr std::uint64_t kOvertureSamples = 2;

}  // namespace

/// Pixels (x + i * step, y + j * step), each with one eye sample.
struct IrradianceBuilder::Lattice {
  int x, y, step;
  std::uint64_t sample;
};

/// A point that no record reaches.
struct IrradianceBuilder::Miss {
  GatherPlace place;
  int x, y;
};

HemisphereSamples IrradianceBuilder::gather(const GatherPlace& place, const HemisphereGrid& grid, std::uint64_t stream,
                                            TileFigures& figures) const {
  const Frame frame = Frame::from_normal(place.normal);
  HemisphereSamples samples{grid, std::vector<Rgb>(grid.cells(), Rgb{0, 0, 0}),
                            std::vector<float>(grid.cells(), kInfinity)};
  for (std::uint32_t cell = 0; cell < grid.cells(); ++cell) {
    PathRng rng(seed_, Stream::kIrradiance, stream, cell);
    const Vec3f direction = frame.to_world(grid.direction(cell, rng.next2()));
    if (dot(direction, place.geometric_normal) <= 0.0f) continue;
    const Vec3f origin = offset_ray_origin(place.position, place.geometric_normal, direction, place.extent);
    const GatherRadiance::Arrival arrival = source_.arriving({origin, direction}, place.media, rng, figures);
    samples.radiance[cell] = arrival.radiance;
    samples.distance[cell] = arrival.distance;
  }
  return samples;
}

void IrradianceBuilder::fill(IrradianceRecord& record, const GatherPlace& place, RecordReach* reach,
                             TileFigures& figures) const {
  const HemisphereSamples samples = gather(place, record.grid(), record.id, figures);
  set_estimate(record, estimate_irradiance(samples, Frame::from_normal(place.normal)));
  if (reach != nullptr) *reach = RecordReach(samples);
}

void IrradianceBuilder::gather_again(IrradianceRecord& record, RecordReach& reach, TileFigures& figures) const {
  MediumStack media;
  if (scene_.any_medium()) {
    const Vec3f outside =
        offset_ray_origin(record.position, record.geometric_normal, record.geometric_normal, record.extent);
    media = MediumStack(scene_.media_around(outside));
  }
  fill(record, GatherPlace(record, media), &reach, figures);
}

void IrradianceBuilder::count_gathered(const IrradianceRecord& record, const TileFigures& tile) {
  ++figures_.gathered;
  figures_.gather_rays += record.grid().cells();
  figures_.rays += tile.rays;
  figures_.faults += tile.faults;
}

namespace {

/// Notes where eye paths gather and find nothing.
struct MissSink {
  const IrradianceCache& cache;
  const Eye& eye;
  std::vector<GatherPlace>& places;
  std::uint64_t rays = 0;

  void ray() { ++rays; }
  void escape(const EyeWalk&) {}
  void emitter(const SurfacePoint&, const Vec3f&, const EyeWalk&) {}
  void first_hit(const Vertex&, float) {}
  void direct(const Vertex&, float, const Vec2f&, float, const EyeWalk&) {}
  void gather(const Vertex& vertex, const Rgb&, const Vec2f&, const EyeWalk& walk) {
    if (!vertex.bsdf.gather_is_lambert() || is_zero(vertex.bsdf.lambert_f())) return;
    if (cache.interpolate(vertex.point.position, vertex.bsdf.ns(), kOvertureTightness)) return;
    places.emplace_back(vertex, walk.media, eye.camera().footprint(walk.distance));
  }
};

}  // namespace

std::vector<IrradianceBuilder::Miss> IrradianceBuilder::misses(const Eye& eye, int max_depth,
                                                               const IrradianceCache& cache, const Lattice& lattice) {
  const auto count = [&](int first, int size) {
    return first < size ? static_cast<std::size_t>((size - 1 - first) / lattice.step + 1) : std::size_t{0};
  };
  const std::size_t columns = count(lattice.x, eye.width()), rows = count(lattice.y, eye.height());
  std::vector<std::vector<Miss>> of_row(rows);
  std::vector<std::uint64_t> rays(rows);
  const EyePaths paths(scene_, eye, max_depth);
  parallel_for(rows, [&](std::size_t row) {
    std::vector<GatherPlace> places;
    for (std::size_t column = 0; column < columns; ++column) {
      const int x = lattice.x + static_cast<int>(column) * lattice.step,
                y = lattice.y + static_cast<int>(row) * lattice.step;
      places.clear();
      MissSink sink{cache, eye, places};
      paths.follow(x, y, lattice.sample, sink);
      rays[row] += sink.rays;
      for (const GatherPlace& place : places) of_row[row].push_back({place, x, y});
    }
  });
  std::vector<Miss> all;
  for (std::size_t row = 0; row < rows; ++row) {
    all.insert(all.end(), of_row[row].begin(), of_row[row].end());
    figures_.rays += rays[row];
  }
  return all;
}

void IrradianceBuilder::overture(const Eye& eye, int max_depth, IrradianceCache& cache, std::uint32_t& next_id,
                                 std::vector<std::uint16_t>& marks, std::vector<RecordReach>* reaches) {
  // From the largest spacing down, every lattice between the points of those before: first the middles of
  // their squares, then of the squares' edges, so that hardly any two points of one lattice are nearer than
  // the records will be.
  std::vector<Lattice> lattices;
  int step = static_cast<int>(std::bit_ceil(static_cast<unsigned>(std::max(1.0, options_.max_spacing))));
  lattices.push_back({0, 0, step, 0});
  const auto refine = [&](int coarse, std::uint64_t sample) {
    const int half = coarse / 2;
    lattices.push_back({half, half, coarse, sample});
    lattices.push_back({half, 0, coarse, sample});
    lattices.push_back({0, half, coarse, sample});
  };
  for (; step > 1; step /= 2) refine(step, 0);
  for (std::uint64_t sample = 1; sample < kOvertureSamples; ++sample) {
    lattices.push_back({0, 0, 2, sample});
    refine(2, sample);
  }
  for (const Lattice& lattice : lattices) {
    const std::vector<Miss> found = misses(eye, max_depth, cache, lattice);
    std::vector<IrradianceRecord> made(found.size());
    std::vector<RecordReach> reached(reaches != nullptr ? found.size() : 0);
    std::vector<TileFigures> tiles(found.size());
    const double part = std::clamp(lattice.step / kUsualStep, kLeastPart, kMostPart);
    const auto rays = static_cast<std::uint32_t>(std::max(1.0, std::round(part * options_.rays)));
    parallel_for(found.size(), [&](std::size_t i) {
      const GatherPlace& place = found[i].place;
      IrradianceRecord& record = made[i];
      record.position = place.position;
      record.normal = place.normal;
      record.geometric_normal = place.geometric_normal;
      record.extent = place.extent;
      // Where the overture finds it too far, it is so many pixels away.
      const double asked = double{kOvertureTightness} * options_.error;
      record.least = static_cast<float>(options_.min_spacing / asked) * place.pixel;
      record.most = static_cast<float>(options_.max_spacing / asked) * place.pixel;
      record.rays = rays;
      record.id = next_id + static_cast<std::uint32_t>(i);
      fill(record, place, reaches != nullptr ? &reached[i] : nullptr, tiles[i]);
    });
    for (std::size_t i = 0; i < found.size(); ++i) {
      cache.insert(made[i]);
      count_gathered(made[i], tiles[i]);
      if (reaches != nullptr) reaches->push_back(std::move(reached[i]));
      if (!marks.empty()) {
        ++marks[static_cast<std::size_t>(found[i].y) * static_cast<std::size_t>(eye.width()) +
                static_cast<std::size_t>(found[i].x)];
      }
    }
    next_id += static_cast<std::uint32_t>(found.size());
  }
  figures_.records = cache.records().size();
}

void IrradianceBuilder::update(IrradianceFile& file, const SceneChange& change, int max_depth, IrradianceCache& cache) {
  enum class Fate : std::uint8_t { kKept, kRenewed, kDropped };
  const std::size_t count = file.records.size();
  std::vector<Fate> fates(count, change.everywhere ? Fate::kDropped : Fate::kKept);
  if (!change.everywhere && !change.empty()) {
    const ChangedLight light(scene_, change, max_depth, seed_);
    figures_.rays += light.rays();
    parallel_for(count, [&](std::size_t i) {
      const IrradianceRecord& record = file.records[i];
      if (change.holds(record.position)) {
        fates[i] = Fate::kDropped;
      } else if (changed_part(record, file.reaches[i], seed_, change, light) > kTouchedPart) {
        fates[i] = Fate::kRenewed;
      }
    });
  }
  std::vector<TileFigures> tiles(count);
  parallel_for(count, [&](std::size_t i) {
    if (fates[i] == Fate::kRenewed) gather_again(file.records[i], file.reaches[i], tiles[i]);
  });
  std::vector<IrradianceRecord> kept;
  std::vector<RecordReach> reaches;
  for (std::size_t i = 0; i < count; ++i) {
    if (fates[i] != Fate::kKept) continue;
    kept.push_back(file.records[i]);
    reaches.push_back(std::move(file.reaches[i]));
  }
  figures_.kept = kept.size();
  figures_.renewed = count - kept.size();
  cache.assign(std::move(kept));
  for (std::size_t i = 0; i < count; ++i) {
    if (fates[i] != Fate::kRenewed) continue;
    cache.insert(file.records[i]);
    reaches.push_back(std::move(file.reaches[i]));
    count_gathered(file.records[i], tiles[i]);
  }
  file.records = cache.records();
  file.reaches = std::move(reaches);
  figures_.records = file.records.size();
}

}  // namespace pf
