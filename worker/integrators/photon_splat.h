#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/spec/job_spec.h"
#include "worker/integrators/eye.h"
#include "worker/integrators/integrator.h"
#include "worker/photon/photon_rays.h"
#include "worker/photon/sample_tree.h"

namespace pf {

/// Photon ray splatting.
///
/// Herzog, Havran, Kinuwaki, Myszkowski and Seidel 2007, "Global Illumination using Photon Ray Splatting", Computer
/// Graphics Forum 26(3); photon differentials: Igehy 1999, "Tracing Ray Differentials"; Schjoth, Frisvad, Erleben and
/// Sporring 2007, "Photon Differentials", GRAPHITE; Frisvad, Schjoth, Erleben and Sporring 2014, "Photon Differential
/// Splatting for Rendering Caustics", Computer Graphics Forum 33(6).
///
/// A sub-pass traces one eye sample of every pixel first and keeps where the samples gather, in a kd-tree over position
/// and normal. Then it traces photon paths and splats each of their rays, not their hits alone, to the samples near the
/// ray: a ray's flux is spread by a kernel over the disc ACROSS the ray, and a sample's own cosine makes irradiance of
/// it. So light at the edge of a surface is not missing, nor does the estimate depend on how surfaces lie to each other
/// in the kernel. Direct light is sampled from the eye; photon rays bring the rest, from their first scattering on.
///
/// A kernel's width follows from the density of its whole path: the inverse densities of all choices that made the path
/// (place on the lamp, direction, each bounce, roulette) add up to the area that a kernel of KernelRule::photons
/// photons covers. It grows with length and bounces. The paper multiplies densities; the sum is the spread of
/// independent displacements, which stays right where a wide bounce follows a narrow one. With
/// photon_splat.differentials the spreads go through curved mirrors and lenses, which focus them: kernels are ellipses,
/// narrow where a caustic is. A diffuse bounce forgets directions and starts a spread of pi / cos; a rough lobe adds 1
/// / pdf to the reflected one.
///
/// Bias: illumination is blurred over the kernel, whatever the number of sub-passes; variance averages out over them.
/// It vanishes with photon_splat.smoothing. At the foot of a wall the part of the disc where no rays can be is left out
/// of the kernel's area. Where it fails: kernels nearly as wide as the room darken it (an enclosed furnace by 2 to 4 %
/// at smoothing 4); thin walls along a ray do not stop its kernel; caustics seen after more than a few curved bounces
/// spread faster than first derivatives say.
///
/// Memory: samples of one sub-pass, about 250 bytes each, and their BSDF (sizeof(Bsdf)) where they are not plain
/// Lambert.
class PhotonSplatIntegrator final : public Integrator {
 public:
  PhotonSplatIntegrator(const Scene& scene, const Camera& camera, const JobSpec& spec);
  [[nodiscard]] FilmOptions film_options() const override { return film_; }
  [[nodiscard]] std::vector<ProgressivePixel> initial_radii() const override { return {}; }
  void run(const WorkUnit& unit, const std::vector<ProgressivePixel>& state, Statistics& sums) const override;

 private:
  struct Gathered;
  struct Glossy;
  struct Samples;
  struct Splats;
  struct TileSamples;
  struct CollectSink;
  struct SplatLight;

  /// Where the eye paths of one sub-pass gather.
  [[nodiscard]] Samples collect(std::uint64_t sub_pass, Statistics& sums) const;
  /// Light that the sub-pass's photon rays bring to the samples, by the samples' ids.
  [[nodiscard]] std::vector<Gathered> splat(std::uint64_t sub_pass, const Samples& samples, Statistics& sums) const;
  /// Photon rays of paths [first, end), with the branches of the tree that they may reach.
  [[nodiscard]] Splats trace(std::uint64_t sub_pass, std::uint32_t first, std::uint32_t end,
                             const SampleTree& tree) const;
  /// Part of a ray's kernel around the sample where no rays can be, below the foot of the surface that the ray left.
  [[nodiscard]] float part_lost(const RayKernel& ray, const SplatSample& sample,
                                const RayKernel::Meeting& meeting) const;
  /// Adds the rays of one batch to the samples of one branch; returns how many contributions were not finite.
  [[nodiscard]] std::uint64_t splat_branch(std::size_t branch, const std::vector<Splats>& batch, const Samples& samples,
                                           std::vector<Gathered>& gathered) const;

  const Scene& scene_;
  Eye eye_;
  PhotonRays rays_;
  FilmOptions film_;
  KernelProfile profile_;
  std::array<KernelRule, kFlows> rules_;
  float least_footprints_ = 0;  ///< narrowest kernel, in pixel footprints
  int max_depth_;
  int light_samples_;
};

}  // namespace pf
