#include "worker/integrators/photon_splat.h"

#include <algorithm>

#include "common/base/parallel.h"
#include "worker/integrators/eye_paths.h"
#include "worker/integrators/single_pass.h"

namespace pf {
namespace {

/// Photons that a kernel holds: few for caustics, whose edges are what one looks at, more where light is smooth.
constexpr float kCausticPhotons = 16.0f;
constexpr float kIndirectPhotons = 32.0f;
/// No kernel is wider than this part of the scene's radius, nor narrower than this part of a pixel's footprint.
constexpr float kWidestShare = 0.05f;
constexpr float kLeastFootprints = 0.75f;

/// Photon paths of one chunk, one thread's work, and chunks that are splatted together.
constexpr std::uint32_t kChunkPaths = 1024;
constexpr std::uint32_t kBatchChunks = 32;

}  // namespace

/// What photon rays brought to a sample: irradiance where it is Lambert, else reflected radiance.
struct PhotonSplatIntegrator::Gathered {
  std::array<Imath::V3d, kFlows> flow{Imath::V3d(0.0), Imath::V3d(0.0)};
};

/// A sample that is not one Lambert reflector, as photon rays see it.
struct PhotonSplatIntegrator::Glossy {
  Bsdf bsdf;
  Vec3f wo;
};

/// Samples of one sub-pass. A sample's id counts in the order of tiles, pixels and gathers.
struct PhotonSplatIntegrator::Samples {
  SampleTree tree;
  std::vector<std::uint32_t> first_of_pixel;
  std::vector<std::int32_t> glossy_of;  ///< by id; -1: Lambert
  std::vector<Glossy> glossy;
};

/// Photon rays of one chunk, and which branches they may reach: those of branch b are reaching[begin_of[b]..begin_of[b
/// + 1]).
struct PhotonSplatIntegrator::Splats {
  struct Splat {
    RayKernel kernel;
    Rgb flux;
    Flow flow;
    MediumStack media;
  };
  std::vector<Splat> rays;
  std::vector<std::uint32_t> begin_of, reaching;
  PhotonRays::Figures figures;
};

/// Where the eye paths of one tile gather.
struct PhotonSplatIntegrator::TileSamples {
  std::vector<SplatSample> samples;
  std::vector<std::uint32_t> count_of_pixel;             ///< of the tile, row by row
  std::vector<std::pair<std::uint32_t, Glossy>> glossy;  ///< with the sample's place in `samples`
};

/// Keeps where eye paths gather.
struct PhotonSplatIntegrator::CollectSink {
  const PhotonSplatIntegrator& integrator;
  TileFigures& figures;
  TileSamples& tile;

  void ray() { ++figures.rays; }
  void escape(const EyeWalk&) {}
  void emitter(const SurfacePoint&, const Vec3f&, const EyeWalk&) {}
  void first_hit(const Vertex&, float) {}
  void direct(const Vertex&, float, const Vec2f&, float, const EyeWalk&) {}
  void gather(const Vertex& vertex, const Rgb&, const Vec2f&, const EyeWalk& walk) {
    const bool lambert = vertex.bsdf.gather_is_lambert();
    if (!lambert)
      tile.glossy.emplace_back(static_cast<std::uint32_t>(tile.samples.size()), Glossy{vertex.bsdf, vertex.wo});
    SplatSample sample;
    sample.position = vertex.point.position;
    sample.ng = vertex.bsdf.ng();
    sample.ns = vertex.bsdf.ns();
    sample.least_radius = integrator.least_footprints_ * integrator.eye_.camera().footprint(walk.distance);
    sample.extent = vertex.point.extent;
    sample.both_sides = vertex.transmissive && !lambert;
    tile.samples.push_back(sample);
    ++tile.count_of_pixel.back();
  }
};

/// The method of the four-part split: what was splatted to the samples of one pixel, in the order in which they were
/// found.
struct PhotonSplatIntegrator::SplatLight {
  const std::vector<Gathered>& gathered;
  std::uint32_t next;

  void gather(const Vertex& vertex, const Rgb& beta, const Vec2f&, const EyeWalk&,
              const FourPartSink<SplatLight>::Layers& to) {
    const Gathered& found = gathered[next++];
    const Rgb scale = vertex.bsdf.gather_is_lambert() ? beta * vertex.bsdf.lambert_f() : beta;
    for (const Flow flow : {kCaustic, kIndirect}) to.add_flow(flow, scale * Rgb(found.flow[flow]));
  }
};

PhotonSplatIntegrator::PhotonSplatIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec)
    : scene_(scene),
      eye_(scene, camera, spec.image.width, spec.image.height, spec.integrator.seed),
      rays_(scene, photon_options(spec), spec.photon_splat.differentials),
      film_(film_of_samples(scene, spec, Extra::kSpecular)),
      profile_(spec.photon_splat.kernel),
      max_depth_(spec.integrator.max_depth),
      light_samples_(std::max(1, spec.integrator.light_samples)) {
  const auto smoothing = static_cast<float>(spec.photon_splat.smoothing);
  least_footprints_ = kLeastFootprints * smoothing;
  const float widest = kWidestShare * 0.5f * length(scene.bounds().size()) * smoothing;
  rules_[kCaustic] = {kCausticPhotons, widest, spec.photon_splat.differentials, smoothing};
  rules_[kIndirect] = {kIndirectPhotons, widest, spec.photon_splat.differentials, smoothing};
}

PhotonSplatIntegrator::Samples PhotonSplatIntegrator::collect(std::uint64_t sub_pass, Statistics& sums) const {
  const auto columns = static_cast<std::size_t>((eye_.width() + kTileEdge - 1) / kTileEdge);
  const auto rows = static_cast<std::size_t>((eye_.height() + kTileEdge - 1) / kTileEdge);
  std::vector<TileSamples> tiles(columns * rows);
  const auto index_of = [&](const Tile& tile) {
    return static_cast<std::size_t>(tile.y0 / kTileEdge) * columns + static_cast<std::size_t>(tile.x0 / kTileEdge);
  };
  const EyePaths eye_paths(scene_, eye_, max_depth_);
  for_each_tile(eye_.width(), eye_.height(), sums, [&](const Tile& tile, TileFigures& figures) {
    TileSamples& found = tiles[index_of(tile)];
    CollectSink sink{*this, figures, found};
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) {
        found.count_of_pixel.push_back(0);
        eye_paths.follow(x, y, sub_pass, sink);
      }
    }
  });
  Samples all;
  all.first_of_pixel.resize(sums.pixels.size());
  std::vector<SplatSample> samples;
  for (std::size_t t = 0; t < tiles.size(); ++t) {
    TileSamples& tile = tiles[t];
    const auto first = static_cast<std::uint32_t>(samples.size());
    std::uint32_t next = first;
    const std::size_t x0 = t % columns * kTileEdge;
    const std::size_t y0 = t / columns * kTileEdge;
    const std::size_t tile_width = std::min<std::size_t>(kTileEdge, static_cast<std::size_t>(eye_.width()) - x0);
    for (std::size_t i = 0; i < tile.count_of_pixel.size(); ++i) {
      const std::size_t pixel = (y0 + i / tile_width) * static_cast<std::size_t>(eye_.width()) + x0 + i % tile_width;
      all.first_of_pixel[pixel] = next;
      next += tile.count_of_pixel[i];
    }
    all.glossy_of.resize(next, -1);
    for (const auto& [place, glossy] : tile.glossy) {
      all.glossy_of[first + place] = static_cast<std::int32_t>(all.glossy.size());
      all.glossy.push_back(glossy);
    }
    for (SplatSample& sample : tile.samples) {
      sample.id = static_cast<std::uint32_t>(samples.size());
      samples.push_back(sample);
    }
    tile = {};
  }
  all.tree = SampleTree(std::move(samples));
  return all;
}

PhotonSplatIntegrator::Splats PhotonSplatIntegrator::trace(std::uint64_t sub_pass, std::uint32_t first,
                                                           std::uint32_t end, const SampleTree& tree) const {
  Splats splats;
  std::vector<PhotonSegment> segments;
  rays_.trace(sub_pass, first, end, segments, splats.figures);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> reached;  // branch, ray
  for (const PhotonSegment& segment : segments) {
    const RayKernel kernel = kernel_of(segment, rays_.options().paths, rules_[segment.flow]);
    const std::size_t before = reached.size();
    const auto index = static_cast<std::uint32_t>(splats.rays.size());
    tree.for_each_branch(kernel,
                         [&](std::size_t branch) { reached.emplace_back(static_cast<std::uint32_t>(branch), index); });
    if (reached.size() > before) splats.rays.push_back({kernel, segment.flux, segment.flow, segment.media});
  }
  // By branch, and within one in the order of the paths.
  splats.begin_of.assign(tree.branches() + 1, 0);
  for (const auto& [branch, ray] : reached) ++splats.begin_of[branch + 1];
  for (std::size_t b = 0; b < tree.branches(); ++b) splats.begin_of[b + 1] += splats.begin_of[b];
  splats.reaching.resize(reached.size());
  std::vector<std::uint32_t> next = splats.begin_of;
  for (const auto& [branch, ray] : reached) splats.reaching[next[branch]++] = ray;
  return splats;
}

float PhotonSplatIntegrator::part_lost(const RayKernel& ray, const SplatSample& sample,
                                       const RayKernel::Meeting& meeting) const {
  constexpr float kLeast = 0.01f;
  const float lost = profile_.beyond(meeting.edge);
  if (lost < kLeast) return 0.0f;
  // Only where the ray's surface goes on to the sample's: along that one, towards its foot, it is in the way.
  const RayKernel::Plane& wall = ray.start();
  const Vec3f towards = sample.ng * dot(wall.normal, sample.ng) - wall.normal;
  const float sine = length(towards);
  if (!(sine > kLeast)) return 0.0f;
  const float height = std::max(0.0f, dot(wall.normal, sample.position) - wall.offset);
  const Vec3f foot = towards / sine;
  const Vec3f origin = offset_ray_origin(sample.position, sample.ng, sample.ng, sample.extent);
  const float beyond = 2.0f * length(origin - sample.position);
  return scene_.occluded({origin, foot, 1.01f * height / sine + beyond}) ? lost : 0.0f;
}

std::uint64_t PhotonSplatIntegrator::splat_branch(std::size_t branch, const std::vector<Splats>& batch,
                                                  const Samples& samples, std::vector<Gathered>& gathered) const {
  std::uint64_t not_finite = 0;
  for (const Splats& splats : batch) {
    for (std::uint32_t r = splats.begin_of[branch]; r < splats.begin_of[branch + 1]; ++r) {
      const Splats::Splat& splat = splats.rays[splats.reaching[r]];
      const Vec3f wi = -splat.kernel.direction();
      samples.tree.for_each_in_branch(branch, splat.kernel, [&](std::size_t index, const RayKernel::Meeting& meeting) {
        const SplatSample& sample = samples.tree.samples()[index];
        // A sample behind the surface that the ray met counts where that surface is not in the way, as beside a box's
        // edge.
        if (meeting.behind > 0.0f) {
          constexpr float kMargin = 1.01f;
          const Vec3f origin = offset_ray_origin(sample.position, sample.ng, wi, sample.extent);
          if (scene_.occluded({origin, wi, kMargin * meeting.behind})) return;
        }
        // Flux density across the ray times the sample's cosine [Herzog et al. 2007], over the part of the disc where
        // rays can be.
        const float there = 1.0f - part_lost(splat.kernel, sample, meeting);
        Rgb light = splat.flux * (profile_(meeting.u2) / (meeting.area * there) * std::abs(dot(wi, sample.ns)));
        const std::int32_t glossy = samples.glossy_of[sample.id];
        if (glossy >= 0) {
          const Glossy& surface = samples.glossy[static_cast<std::size_t>(glossy)];
          light *= surface.bsdf.eval(surface.wo, wi, Transport::kRadiance, Portion::kGather);
        }
        if (!splat.media.empty()) light *= splat.media.transmittance(scene_, std::max(0.0f, meeting.t));
        if (!is_finite(light)) {
          ++not_finite;
          return;
        }
        gathered[sample.id].flow[splat.flow] += Imath::V3d(light);
      });
    }
  }
  return not_finite;
}

std::vector<PhotonSplatIntegrator::Gathered> PhotonSplatIntegrator::splat(std::uint64_t sub_pass,
                                                                          const Samples& samples,
                                                                          Statistics& sums) const {
  std::vector<Gathered> gathered(samples.glossy_of.size());
  const std::uint32_t paths = rays_.options().paths;
  const std::uint32_t chunks = (paths + kChunkPaths - 1) / kChunkPaths;
  for (std::uint32_t first = 0; first < chunks; first += kBatchChunks) {
    std::vector<Splats> batch(std::min(kBatchChunks, chunks - first));
    parallel_for(batch.size(), [&](std::size_t i) {
      const std::uint32_t begin = (first + static_cast<std::uint32_t>(i)) * kChunkPaths;
      batch[i] = trace(sub_pass, begin, std::min(paths, begin + kChunkPaths), samples.tree);
    });
    // Each sample is added to by one thread, ray after ray: sums have one order.
    std::vector<std::uint64_t> not_finite(samples.tree.branches());
    parallel_for(samples.tree.branches(),
                 [&](std::size_t branch) { not_finite[branch] = splat_branch(branch, batch, samples, gathered); });
    for (const Splats& splats : batch) {
      sums.rays += splats.figures.rays;
      sums.faults += splats.figures.faults;
      sums.photons_stored += splats.rays.size();
    }
    for (const std::uint64_t count : not_finite) sums.faults.not_finite += count;
  }
  sums.photon_paths += paths;
  return gathered;
}

void PhotonSplatIntegrator::run(const WorkUnit& unit, const std::vector<ProgressivePixel>&, Statistics& sums) const {
  for (std::uint64_t s = unit.first_sub_pass; s < unit.first_sub_pass + unit.sub_passes; ++s) {
    const Samples samples = collect(s, sums);
    const std::vector<Gathered> gathered = splat(s, samples, sums);
    // The eye paths once more, the same to the bit, now with what was splatted to their ends.
    const EyePaths eye_paths(scene_, eye_, max_depth_);
    for_each_pixel(eye_.width(), eye_.height(), sums, [&](int x, int y, TileFigures& figures) {
      const std::size_t i =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(eye_.width()) + static_cast<std::size_t>(x);
      Tally tally(sums.pixels[i], &sums.extras[i], film_.scale, figures.faults);
      const PixelTarget target{x, y, s, tally, s < kFeatureSubPasses ? &sums.features[i] : nullptr, figures};
      SplatLight light{gathered, samples.first_of_pixel[i]};
      FourPartSink<SplatLight> sink(scene_, film_.scale, light_samples_, target, light);
      eye_paths.follow(x, y, s, sink);
      tally.commit();
    });
    ++sums.sub_passes;
  }
}

}  // namespace pf
