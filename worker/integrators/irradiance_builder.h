#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/spec/job_spec.h"
#include "worker/integrators/eye.h"
#include "worker/integrators/gather_rays.h"
#include "worker/photon/irradiance_cache.h"
#include "worker/photon/irradiance_file.h"
#include "worker/photon/irradiance_update.h"

namespace pf {

/// Point of a surface where irradiance is asked for.
struct GatherPlace {
  Vec3f position;
  Vec3f normal;            ///< of shading, on the side that gathers
  Vec3f geometric_normal;  ///< likewise
  float extent = 0;        ///< SurfacePoint::extent
  float pixel = 0;         ///< edge of a pixel's footprint there [m]
  MediumStack media;

  GatherPlace(const Vertex& vertex, const MediumStack& around, float footprint)
      : position(vertex.point.position),
        normal(vertex.bsdf.ns()),
        geometric_normal(vertex.bsdf.ng()),
        extent(vertex.point.extent),
        pixel(footprint),
        media(around) {}
  GatherPlace(const IrradianceRecord& record, const MediumStack& around)
      : position(record.position),
        normal(record.normal),
        geometric_normal(record.geometric_normal),
        extent(record.extent),
        media(around) {}
};

/// What building took.
struct IrradianceFigures {
  std::uint64_t records = 0;   ///< in the cache
  std::uint64_t gathered = 0;  ///< hemispheres of gather rays: records made or made again
  std::uint64_t kept = 0;      ///< records of a file that were taken over as they were
  std::uint64_t renewed = 0;   ///< records of a file that were gathered again, or dropped
  std::uint64_t gather_rays = 0;
  std::uint64_t rays = 0;  ///< all that were shot
  Faults faults;
};

/// Fills an irradiance cache: looks for points of the image where no record reaches, and gathers there.
class IrradianceBuilder {
 public:
  /// `seed`: of the gather rays' random numbers.
  IrradianceBuilder(const Scene& scene, const GatherRadiance& source, const JobSpec::IrradianceCache& options,
                    std::uint64_t seed)
      : scene_(scene), source_(source), options_(options), seed_(seed) {}

  /// Gather rays of one hemisphere, one a cell of `grid`; `stream` names their random numbers. Where a ray
  /// would start below the true surface nothing arrives.
  [[nodiscard]] HemisphereSamples gather(const GatherPlace& place, const HemisphereGrid& grid, std::uint64_t stream,
                                         TileFigures& figures) const;

  /// Overture: makes records for what the image will ask, from coarse lattices of pixels to fine ones [Ward
  /// 1988, 4.2; Krivanek and Gautron 2009, 5.1]. All points of a lattice are looked up in what the lattices
  /// before left, then gathered at once and inserted in the order of the pixels: the result depends on
  /// neither threads nor the order of the lookups. Records of coarse lattices serve many pixels and get more rays,
  /// those of fine ones fewer, in proportion to their spacing. `marks`, when not empty, counts the records made at each
  /// pixel. New records' reaches are appended to `reaches`, when not null.
  void overture(const Eye& eye, int max_depth, IrradianceCache& cache, std::uint32_t& next_id,
                std::vector<std::uint16_t>& marks, std::vector<RecordReach>* reaches);
  /// Takes over the records of `file` that the change of the scene cannot have touched (changed_part) and
  /// gathers again at the others; those in or on what changed are dropped. `file` then holds the cache's
  /// records and reaches.
  void update(IrradianceFile& file, const SceneChange& change, int max_depth, IrradianceCache& cache);

  [[nodiscard]] const IrradianceFigures& figures() const { return figures_; }

 private:
  struct Lattice;
  struct Miss;
  [[nodiscard]] std::vector<Miss> misses(const Eye& eye, int max_depth, const IrradianceCache& cache,
                                         const Lattice& lattice);
  void fill(IrradianceRecord& record, const GatherPlace& place, RecordReach* reach, TileFigures& figures) const;
  /// Gathers again at `record`, whose place stays.
  void gather_again(IrradianceRecord& record, RecordReach& reach, TileFigures& figures) const;
  void count_gathered(const IrradianceRecord& record, const TileFigures& tile);

  const Scene& scene_;
  const GatherRadiance& source_;
  JobSpec::IrradianceCache options_;
  std::uint64_t seed_;
  IrradianceFigures figures_;
};

}  // namespace pf
