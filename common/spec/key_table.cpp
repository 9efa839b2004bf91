#include "common/spec/key_table.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <type_traits>
#include <utility>

namespace pf::spec {
namespace {

constexpr std::array<std::string_view, 8> kIntegrators = {
    "auto", "path", "photon_map", "final_gather", "irradiance_cache", "photon_splat", "ppm", "sppm"};
constexpr std::array<std::string_view, 2> kModes = {"shared", "independent"};
constexpr std::array<std::string_view, 3> kFilters = {"disc", "cone", "gaussian"};
constexpr std::array<std::string_view, 3> kSwitches = {"auto", "on", "off"};
constexpr std::array<std::string_view, 2> kGatherSources = {"photon_map", "path"};
constexpr std::array<std::string_view, 3> kSplatKernels = {"epanechnikov", "cone", "gaussian"};
constexpr std::array<std::string_view, 2> kSceneFiles = {".gltf", ".glb"};
constexpr std::array<std::string_view, 1> kCacheFiles = {".pfcache"};
constexpr std::array<std::string_view, 2> kEnvironmentFiles = {".hdr", ".exr"};

constexpr double kMaxMetres = 1e9;
constexpr double kMaxRadiance = 1e12;
constexpr double kMaxSeconds = 1e9;             // 31 years
constexpr std::int64_t kMax32 = 4'294'967'295;  // path and sub-pass indices of the random streams
constexpr std::int64_t kMaxSeed = INT64_MAX;    // what a TOML integer can say

// A field is named by the member of JobSpec that is its table and the member of that table.
template <auto kTable, auto kField>
using FieldType = std::remove_cvref_t<decltype(std::declval<JobSpec>().*kTable.*kField)>;

template <auto kTable, auto kField>
constexpr IntegerKind integer(std::int64_t min, std::int64_t max) {
  using T = FieldType<kTable, kField>;
  return {min, max, [](const JobSpec& spec) { return static_cast<std::int64_t>(spec.*kTable.*kField); },
          [](JobSpec& spec, std::int64_t value) { spec.*kTable.*kField = static_cast<T>(value); }};
}

template <auto kTable, auto kField>
constexpr RealKind real(double min, double max, bool above_min = false) {
  return {min, max, above_min, [](const JobSpec& spec) { return spec.*kTable.*kField; },
          [](JobSpec& spec, double value) { spec.*kTable.*kField = value; }};
}

template <auto kTable, auto kField>
constexpr RealsKind reals(std::size_t count, double min, double max) {
  return {count, min, max, [](const JobSpec& spec) -> const std::vector<double>& { return spec.*kTable.*kField; },
          // NOLINTNEXTLINE(performance-unnecessary-value-param): before instantiation no move is seen
          [](JobSpec& spec, std::vector<double> value) { spec.*kTable.*kField = std::move(value); }};
}

template <auto kTable, auto kField>
constexpr TextKind text(TextForm form, std::size_t max_bytes, std::span<const std::string_view> extensions = {}) {
  return {form, max_bytes, extensions, [](const JobSpec& spec) -> const std::string& { return spec.*kTable.*kField; },
          // NOLINTNEXTLINE(performance-unnecessary-value-param): before instantiation no move is seen
          [](JobSpec& spec, std::string value) { spec.*kTable.*kField = std::move(value); }};
}

template <auto kTable, auto kField>
constexpr ChoiceKind choice(std::span<const std::string_view> names) {
  using T = FieldType<kTable, kField>;
  return {names, [](const JobSpec& spec) { return static_cast<std::size_t>(spec.*kTable.*kField); },
          [](JobSpec& spec, std::size_t index) { spec.*kTable.*kField = static_cast<T>(index); }};
}

template <auto kTable, auto kField>
constexpr BooleanKind boolean() {
  return {[](const JobSpec& spec) { return spec.*kTable.*kField; },
          [](JobSpec& spec, bool value) { spec.*kTable.*kField = value; }};
}

constexpr IntegerKind kVersion = {1, 1, [](const JobSpec& spec) { return std::int64_t{spec.spec_version}; },
                                  [](JobSpec& spec, std::int64_t v) { spec.spec_version = static_cast<int>(v); }};

constexpr std::array<Table, 13> kTables = {{
    {"job", "The job itself."},
    {"scene", "What is rendered. Paths are relative to the job file; nothing outside its folder is read."},
    {"image", "The picture."},
    {"integrator", "How light is computed."},
    {"ppm", "Where the eye of ppm looks."},
    {"photon_map", "The photon maps of photon_map, final_gather and irradiance_cache."},
    {"final_gather", "Indirect light of final_gather."},
    {"irradiance_cache", "Indirect light of irradiance_cache."},
    {"cache", "Where irradiance_cache keeps its records between renders."},
    {"photon_splat", "Photon rays of photon_splat."},
    {"stop", "When the job is done: whichever comes first. At least one bound must be given."},
    {"checkpoint", "What an interruption may cost."},
    {"faults", "What a farm does about workers that fail."},
}};

using S = JobSpec;
constexpr auto kJob = &S::job;
constexpr auto kScene = &S::scene;
constexpr auto kImage = &S::image;
constexpr auto kIntegrator = &S::integrator;
constexpr auto kPpm = &S::ppm;
constexpr auto kPhotonMap = &S::photon_map;
constexpr auto kFinalGather = &S::final_gather;
constexpr auto kIrradianceCache = &S::irradiance_cache;
constexpr auto kCache = &S::cache;
constexpr auto kPhotonSplat = &S::photon_splat;
constexpr auto kStop = &S::stop;
constexpr auto kCheckpoint = &S::checkpoint;
constexpr auto kFaults = &S::faults;

constexpr bool kRequired = true, kOptional = false;
constexpr bool kDecides = true, kIrrelevant = false;

constexpr std::array kKeys = {
    Key{"", "spec_version", kOptional, kDecides, "", "Version of this format.", kVersion},

    Key{"job", "name", kRequired, kIrrelevant, "", "Names the job and its output files.",
        text<kJob, &S::Job::name>(TextForm::kJobName, 100)},
    Key{"job", "priority", kOptional, kIrrelevant, "", "Jobs of higher priority are served first.",
        integer<kJob, &S::Job::priority>(0, 100)},

    Key{"scene", "file", kRequired, kDecides, "", "The glTF scene.",
        text<kScene, &S::Scene::file>(TextForm::kPath, 1024, kSceneFiles)},
    Key{"scene", "environment", kOptional, kDecides, "",
        "Latitude-longitude map that lights the scene from all sides; empty: none.",
        text<kScene, &S::Scene::environment>(TextForm::kPath, 1024, kEnvironmentFiles)},
    Key{"scene", "environment_scale", kOptional, kDecides, "",
        "Multiplies the radiance of the map, or environment_radiance.",
        real<kScene, &S::Scene::environment_scale>(0, kMaxRadiance)},
    Key{"scene", "environment_radiance", kOptional, kDecides, "W/(sr m^2)",
        "Constant red, green and blue radiance from all sides, instead of a map; empty: none.",
        reals<kScene, &S::Scene::environment_radiance>(3, 0, kMaxRadiance)},
    Key{"scene", "camera", kOptional, kDecides, "", "Name of a camera of the glTF file; empty: the first.",
        text<kScene, &S::Scene::camera>(TextForm::kFree, 256)},
    Key{"scene", "scene", kOptional, kDecides, "",
        "Name or index of a scene of the glTF file; empty: the file's default.",
        text<kScene, &S::Scene::scene>(TextForm::kFree, 256)},
    Key{"scene", "lens_radius", kOptional, kDecides, "m", "Radius of the lens; 0: a pinhole, all is sharp.",
        real<kScene, &S::Scene::lens_radius>(0, kMaxMetres)},
    Key{"scene", "focus_distance", kOptional, kDecides, "m", "Distance at which a lens is sharp.",
        real<kScene, &S::Scene::focus_distance>(0, kMaxMetres, true)},

    Key{"image", "width", kOptional, kDecides, "pixels", "Width; width times height is at most 268435456.",
        integer<kImage, &S::Image::width>(1, 65536)},
    Key{"image", "height", kOptional, kDecides, "pixels", "Height.", integer<kImage, &S::Image::height>(1, 65536)},
    Key{"image", "exposure", kOptional, kIrrelevant, "stops", "Brightness of the PNG; the EXR is not touched.",
        real<kImage, &S::Image::exposure>(-64, 64)},

    Key{"integrator", "type", kOptional, kDecides, "",
        "The algorithm; auto takes the one that a pilot of photons and eye paths foretells to be the fastest "
        "(photonfarm plan).",
        choice<kIntegrator, &S::Integrator::type>(kIntegrators)},
    Key{"integrator", "mode", kOptional, kDecides, "",
        "ppm and sppm: shared statistics with growing rounds, or independent passes.",
        choice<kIntegrator, &S::Integrator::mode>(kModes)},
    Key{"integrator", "photons", kOptional, kDecides, "paths",
        "Photon paths of a sub-pass; 0: from 10000 to 2000000, two a pixel or for sppm four and not fewer than 50000, "
        "and 500000 for "
        "photon_map, final_gather and irradiance_cache.",
        integer<kIntegrator, &S::Integrator::photons>(0, kMax32)},
    Key{"integrator", "round_growth", kOptional, kDecides, "",
        "After n sub-passes the next round holds 1 + floor(round_growth n), at least 2, less what is over a multiple "
        "of 2 (of 4 from 8 on, of 8 from 16 on, and so on). 0: rounds of one sub-pass.",
        real<kIntegrator, &S::Integrator::round_growth>(0, 1000)},
    Key{"integrator", "alpha", kOptional, kDecides, "",
        "Fraction of new photons that ppm and sppm keep; smaller shrinks the radius faster.",
        real<kIntegrator, &S::Integrator::alpha>(0, 1, true)},
    Key{"integrator", "initial_radius", kOptional, kDecides, "m",
        "First gather radius; 0: chosen for each pixel from the scene, which is nearly always right.",
        real<kIntegrator, &S::Integrator::initial_radius>(0, kMaxMetres)},
    Key{"integrator", "max_depth", kOptional, kDecides, "bounces", "Longest path; 0: ended by Russian roulette alone.",
        integer<kIntegrator, &S::Integrator::max_depth>(0, 65535)},
    Key{"integrator", "guide_emission", kOptional, kDecides, "",
        "ppm, sppm: photons start where a pilot found that it matters; auto: where that is foretold to save a sixth of "
        "the work.",
        choice<kIntegrator, &S::Integrator::guide_emission>(kSwitches)},
    Key{"integrator", "light_samples", kOptional, kDecides, "samples",
        "Samples of direct light at each point that the eye sees, spread over the lamps; 0: 1 to 8, by what a pilot "
        "found "
        "them to save. path takes one.",
        integer<kIntegrator, &S::Integrator::light_samples>(0, 64)},
    Key{"integrator", "error_estimate", kOptional, kDecides, "",
        "ppm and sppm estimate each pixel's noise and bias, as layers; with stop.error they always do.",
        boolean<kIntegrator, &S::Integrator::error_estimate>()},
    Key{"integrator", "seed", kOptional, kDecides, "", "Seed of all random numbers of the job.",
        integer<kIntegrator, &S::Integrator::seed>(0, kMaxSeed)},

    Key{"ppm", "eye_samples", kOptional, kDecides, "samples", "Eye samples of a pixel, the same in every sub-pass.",
        integer<kPpm, &S::Ppm::eye_samples>(1, 1024)},
    Key{"ppm", "hit_points", kOptional, kDecides, "hit points",
        "Hit points of a pixel that keep statistics of their own, at most; 132 bytes each.",
        integer<kPpm, &S::Ppm::hit_points>(1, 1024)},
    Key{"photon_map", "caustic_photons", kOptional, kDecides, "paths",
        "Photon paths of the caustic map; those of the global map are integrator.photons.",
        integer<kPhotonMap, &S::PhotonMap::caustic_photons>(1, kMax32)},
    Key{"photon_map", "caustic_map", kOptional, kDecides, "",
        "The caustic map; auto: where light reaches a surface by mirrors or glass.",
        choice<kPhotonMap, &S::PhotonMap::caustic_map>(kSwitches)},
    Key{"photon_map", "nearest", kOptional, kDecides, "photons", "Photons of an estimate from the global map.",
        integer<kPhotonMap, &S::PhotonMap::nearest>(1, 10000)},
    Key{"photon_map", "caustic_nearest", kOptional, kDecides, "photons", "Photons of an estimate from the caustic map.",
        integer<kPhotonMap, &S::PhotonMap::caustic_nearest>(1, 10000)},
    Key{"photon_map", "max_distance", kOptional, kDecides, "m",
        "No photon further away counts in an estimate; 0: chosen from the scene.",
        real<kPhotonMap, &S::PhotonMap::max_distance>(0, kMaxMetres)},
    Key{"photon_map", "filter", kOptional, kDecides, "", "How an estimate weighs photons by distance.",
        choice<kPhotonMap, &S::PhotonMap::filter>(kFilters)},
    Key{"photon_map", "projection_map", kOptional, kDecides, "",
        "Photons only towards what the lights see; auto: where that is little.",
        choice<kPhotonMap, &S::PhotonMap::projection_map>(kSwitches)},
    Key{"photon_map", "show_map", kOptional, kDecides, "",
        "photon_map shows the estimate from its map at the first surfaces, and nothing else.",
        boolean<kPhotonMap, &S::PhotonMap::show_map>()},

    Key{"final_gather", "rays", kOptional, kDecides, "rays", "Gather rays of one point.",
        integer<kFinalGather, &S::FinalGather::rays>(1, 65536)},
    Key{"final_gather", "importance", kOptional, kDecides, "",
        "Part of the gather rays that is sampled from the photons around the point.",
        real<kFinalGather, &S::FinalGather::importance>(0, 1)},
    Key{"final_gather", "precompute", kOptional, kDecides, "",
        "Irradiance is computed at photons beforehand; gather rays then ask for the nearest alone.",
        boolean<kFinalGather, &S::FinalGather::precompute>()},
    Key{"final_gather", "error", kOptional, kDecides, "",
        "Bound on the relative error of interpolating between gather points; 0: gather at every sample.",
        real<kFinalGather, &S::FinalGather::error>(0, 1)},

    Key{"irradiance_cache", "error", kOptional, kDecides, "",
        "Error that a record may be used with; smaller: more records, of fewer rays each.",
        real<kIrradianceCache, &S::IrradianceCache::error>(0, 1, true)},
    Key{"irradiance_cache", "rays", kOptional, kDecides, "rays",
        "Gather rays of a record that stands for 16 pixels each way; those that stand for more get up to 8 times as "
        "many, those for less down to an eighth.",
        integer<kIrradianceCache, &S::IrradianceCache::rays>(4, 65536)},
    Key{"irradiance_cache", "min_spacing", kOptional, kDecides, "pixels", "Least distance between records.",
        real<kIrradianceCache, &S::IrradianceCache::min_spacing>(0, 1000)},
    Key{"irradiance_cache", "max_spacing", kOptional, kDecides, "pixels",
        "Greatest distance that a record is used over.",
        real<kIrradianceCache, &S::IrradianceCache::max_spacing>(1, 10000)},
    Key{"irradiance_cache", "source", kOptional, kDecides, "", "Where gather rays take their radiance from.",
        choice<kIrradianceCache, &S::IrradianceCache::source>(kGatherSources)},

    Key{"cache", "file", kOptional, kDecides, "",
        "Records of irradiance_cache are read from this file when it is there, and written to it.",
        text<kCache, &S::Cache::file>(TextForm::kPath, 1024, kCacheFiles)},

    Key{"photon_splat", "kernel", kOptional, kDecides, "", "How a photon ray's light spreads around it.",
        choice<kPhotonSplat, &S::PhotonSplat::kernel>(kSplatKernels)},
    Key{"photon_splat", "differentials", kOptional, kDecides, "",
        "Footprints follow from photon differentials: elliptic, sharp where light is focused.",
        boolean<kPhotonSplat, &S::PhotonSplat::differentials>()},
    Key{"photon_splat", "smoothing", kOptional, kDecides, "", "Multiplies the width of all kernels.",
        real<kPhotonSplat, &S::PhotonSplat::smoothing>(0, 1000, true)},

    Key{"stop", "passes", kOptional, kIrrelevant, "sub-passes",
        "Sub-passes; for path samples per pixel, for photon_map, final_gather and irradiance_cache the same in fours; "
        "0: no bound.",
        integer<kStop, &S::Stop::passes>(0, kMax32)},
    Key{"stop", "seconds", kOptional, kIrrelevant, "s", "Seconds of rendering; 0: no bound.",
        real<kStop, &S::Stop::seconds>(0, kMaxSeconds)},
    Key{"stop", "error", kOptional, kIrrelevant, "",
        "Estimated relative error of the image (ppm and sppm: noise and bias); 0: no bound.",
        real<kStop, &S::Stop::error>(0, 1)},
    Key{"stop", "memory", kOptional, kIrrelevant, "MiB",
        "Resident memory of photonfarm render after which no pass is begun; 0: no bound. A farm's workers do not look "
        "at it.",
        integer<kStop, &S::Stop::memory>(0, kMax32)},

    Key{"checkpoint", "seconds", kOptional, kIrrelevant, "s",
        "Least time between two checkpoints; 0: one after every work unit.",
        real<kCheckpoint, &S::Checkpoint::seconds>(0, kMaxSeconds)},

    Key{"faults", "max_attempts", kOptional, kIrrelevant, "attempts", "Attempts at one work unit before the job fails.",
        integer<kFaults, &S::Faults::max_attempts>(1, 1000)},
    Key{"faults", "unit_timeout_seconds", kOptional, kIrrelevant, "s",
        "Silence after which a work unit is given to another worker.",
        real<kFaults, &S::Faults::unit_timeout_seconds>(0, kMaxSeconds, true)},
};

std::string with_unit(std::string words, const Key& key) {
  if (!key.unit.empty()) words += fmt::format(" ({})", key.unit);
  return words;
}

struct Describe {
  const Key& key;

  std::string operator()(const IntegerKind& kind) const {
    if (kind.min == kind.max) return fmt::format("{}", kind.min);
    return with_unit(fmt::format("an integer from {} to {}", kind.min, kind.max), key);
  }
  std::string operator()(const RealKind& kind) const {
    const std::string_view from = kind.above_min ? "above" : "from";
    return with_unit(fmt::format("a number {} {} {} {}", from, kind.min, kind.above_min ? "and up to" : "to", kind.max),
                     key);
  }
  std::string operator()(const RealsKind& kind) const {
    return with_unit(fmt::format("an array of {} numbers from {} to {}, or []", kind.count, kind.min, kind.max), key);
  }
  std::string operator()(const TextKind& kind) const {
    switch (kind.form) {
      case TextForm::kJobName:
        return fmt::format("a string of 1 to {} characters out of A-Z a-z 0-9 . _ -, other than . and ..",
                           kind.max_bytes);
      case TextForm::kPath:
        return fmt::format("a relative path below the job file's folder that ends in {}",
                           fmt::join(kind.extensions, " or "));
      case TextForm::kFree:
        return fmt::format("a string of at most {} bytes of UTF-8 without control characters", kind.max_bytes);
    }
    return "a string";
  }
  std::string operator()(const ChoiceKind& kind) const { return fmt::format("one of {}", fmt::join(kind.names, ", ")); }
  std::string operator()(const BooleanKind&) const { return "true or false"; }
};

}  // namespace

std::span<const Key> job_keys() { return kKeys; }
std::span<const Table> job_tables() { return kTables; }
std::span<const std::string_view> integrator_names() { return kIntegrators; }
std::span<const std::string_view> mode_names() { return kModes; }

const Key* find_key(std::string_view table, std::string_view name) {
  const auto found =
      std::ranges::find_if(kKeys, [&](const Key& key) { return key.table == table && key.name == name; });
  return found == kKeys.end() ? nullptr : &*found;
}

std::string full_name(const Key& key) {
  return key.table.empty() ? std::string(key.name) : fmt::format("{}.{}", key.table, key.name);
}

std::string expectation(const Key& key) { return std::visit(Describe{key}, key.kind); }

}  // namespace pf::spec
