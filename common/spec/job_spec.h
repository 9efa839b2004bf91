#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

namespace pf {

enum class IntegratorType { kAuto, kPath, kPhotonMap, kFinalGather, kIrradianceCache, kPhotonSplat, kPpm, kSppm };
enum class ProgressiveMode { kShared, kIndependent };
enum class PhotonFilter { kDisc, kCone, kGaussian };
enum class Switch { kAuto, kOn, kOff };
enum class GatherSource { kPhotonMap, kPath };
enum class SplatKernel { kEpanechnikov, kCone, kGaussian };

/// One job: what a user submits. Field by field the job file of the contract (README, jobs/SPEC.md); every
/// field has its default here and nowhere else.
struct JobSpec {
  int spec_version = 1;
  struct Job {
    std::string name;   ///< required; [A-Za-z0-9._-]{1,100}
    int priority = 50;  ///< 0..100
  } job;
  struct Scene {
    std::string file;                          ///< required; relative to the job file's folder, never outside it
    std::string environment;                   ///< .hdr/.exr, or empty
    double environment_scale = 1.0;            ///< multiplies the map or environment_radiance
    std::vector<double> environment_radiance;  ///< empty or three numbers; not with a map
    std::string camera;                        ///< name of a glTF camera; empty: the first
    std::string scene;                         ///< name or index of a glTF scene; empty: the document's default
    double lens_radius = 0.0;                  ///< metres; 0 is a pinhole
    double focus_distance = 1.0;               ///< metres
  } scene;
  struct Image {
    int width = 640;
    int height = 480;
    double exposure = 0.0;  ///< stops, PNG only
  } image;
  struct Integrator {
    IntegratorType type = IntegratorType::kAuto;
    ProgressiveMode mode = ProgressiveMode::kShared;
    std::int64_t photons = 0;  ///< paths per sub-pass; 0: photon_paths() chooses
    double round_growth = 0.25;
    double alpha = 0.6667;
    double initial_radius = 0.0;            ///< metres; 0: per pixel, from the scene
    int max_depth = 32;                     ///< bounces; 0: no bound but Russian roulette
    Switch guide_emission = Switch::kAuto;  ///< ppm, sppm; the planner resolves kAuto
    int light_samples = 0;                  ///< of lamps at a point that the eye sees; the planner resolves 0
    bool error_estimate = false;            ///< ppm, sppm: layers of noise and bias
    std::uint64_t seed = 1;
  } integrator;
  struct Ppm {
    int eye_samples = 4;  ///< of a pixel, the same in every sub-pass
    int hit_points = 8;   ///< statistics of a pixel, at most
  } ppm;
  /// The maps of photon_map, final_gather and irradiance_cache.
  struct PhotonMap {
    std::int64_t caustic_photons = 500000;  ///< paths of the caustic map; those of the global one: integrator.photons
    Switch caustic_map = Switch::kAuto;     ///< the planner resolves kAuto; a method that meets it takes it for on
    int nearest = 100;                      ///< photons of an estimate from the global map
    int caustic_nearest = 60;               ///< same, caustic map
    double max_distance = 0.0;              ///< metres; 0: from the scene
    PhotonFilter filter = PhotonFilter::kCone;
    Switch projection_map = Switch::kAuto;
    bool show_map = false;  ///< photon_map: the map's estimate at what the eye sees, and nothing else
  } photon_map;
  struct FinalGather {
    int rays = 256;           ///< of one hemisphere
    double importance = 0.5;  ///< part of them that is sampled from the photon map
    bool precompute = true;   ///< irradiance at photons
    double error = 0.2;       ///< bound on the relative error of interpolation; 0: gather at every sample
  } final_gather;
  struct IrradianceCache {
    double error = 0.4;          ///< a of [Ward 1988]; smaller: more records
    int rays = 1024;             ///< of one record that serves 16 pixels each way; others by what they serve
    double min_spacing = 3.0;    ///< pixels between records, at least
    double max_spacing = 100.0;  ///< at most
    GatherSource source = GatherSource::kPhotonMap;
  } irradiance_cache;
  struct Cache {
    std::string file;  ///< records are read from here and written back; empty: none
  } cache;
  struct PhotonSplat {
    SplatKernel kernel = SplatKernel::kEpanechnikov;
    bool differentials = true;  ///< footprints from photon differentials
    double smoothing = 1.0;     ///< multiplies the kernels' widths
  } photon_splat;
  struct Stop {
    std::int64_t passes = 64;  ///< 0: no bound
    double seconds = 0;        ///< 0: no bound
    double error = 0;          ///< 0: no bound
    std::int64_t memory = 0;   ///< MiB; 0: no bound
  } stop;
  struct Checkpoint {
    double seconds = 30;
  } checkpoint;
  struct Faults {
    int max_attempts = 5;
    double unit_timeout_seconds = 600;
  } faults;

  /// The folder that relative paths start from; not part of the canonical form.
  std::filesystem::path folder;
};

/// Parses and checks a job file (TOML, or JSON when it ends in .json). Overrides are arguments of `--set`,
/// `table.key=value`. Errors: kInvalidSpec with `file:line:column: ...` or `--set argument: ...`.
[[nodiscard]] Result<JobSpec> load_job(const std::filesystem::path& file,
                                       const std::vector<std::string>& overrides = {});
/// Same from text; `origin` stands for the file in messages.
[[nodiscard]] Result<JobSpec> parse_job_toml(std::string_view text, std::string_view origin,
                                             const std::vector<std::string>& overrides = {});
[[nodiscard]] Result<JobSpec> parse_job_json(std::string_view text, std::string_view origin,
                                             const std::vector<std::string>& overrides = {});
/// Photon paths of a sub-pass as far as the job alone says: where it leaves them open, 500,000 for the methods of maps,
/// and two a pixel for the others, which the planner may change for sppm between these bounds.
[[nodiscard]] std::int64_t photon_paths(const JobSpec& spec);
inline constexpr std::int64_t kFewestPhotonPaths = 10'000, kMostPhotonPaths = 2'000'000;
/// Whether so many photon paths may be those of a sub-pass: exactly the job's number, or one that the planner may
/// choose.
[[nodiscard]] bool may_trace(const JobSpec& spec, std::uint64_t paths);
/// Canonical JSON: all keys, sorted, defaults filled in; equal specs give equal text.
[[nodiscard]] std::string canonical_json(const JobSpec& spec);
/// SHA-256 (hex) of the part of the canonical form that decides the pixels of the EXR: without job,
/// image.exposure, stop, checkpoint and faults.
[[nodiscard]] std::string image_hash_of_spec(const JobSpec& spec);
/// JSON Schema of the job model, generated from the same table as the parser.
[[nodiscard]] std::string job_json_schema();
/// The reference of the job file in Markdown (jobs/SPEC.md), generated from the same table.
[[nodiscard]] std::string job_spec_reference();
[[nodiscard]] std::string_view to_string(IntegratorType type);
[[nodiscard]] std::string_view to_string(ProgressiveMode mode);

}  // namespace pf
