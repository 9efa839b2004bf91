#include "worker/integrators/irradiance_store.h"

#include <algorithm>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"

namespace pf {
namespace {

/// Larger than any cache that is worth reading back.
constexpr std::uint64_t kMaxFileBytes = std::uint64_t{8} << 30;

/// What decides a record's value besides the scene: how its rays are made and followed.
std::uint64_t hash_of_options(const JobSpec& spec) {
  std::string text = fmt::format("{} {} {}", static_cast<int>(spec.irradiance_cache.source), spec.irradiance_cache.rays,
                                 spec.integrator.max_depth);
  if (spec.irradiance_cache.source == GatherSource::kPhotonMap) {
    const JobSpec::PhotonMap& map = spec.photon_map;
    text +=
        fmt::format(" {} {} {} {}", photon_paths(spec), map.nearest, map.max_distance, static_cast<int>(map.filter));
    text += spec.final_gather.precompute ? " precomputed" : "";
  }
  return xxh3_64(text);
}

/// What decides which points an overture looks up.
std::uint64_t hash_of_view(const JobSpec& spec, const Camera& camera) {
  std::string text =
      fmt::format("{} {} {} {} {} {}", spec.image.width, spec.image.height, spec.integrator.seed,
                  spec.irradiance_cache.error, spec.irradiance_cache.min_spacing, spec.irradiance_cache.max_spacing);
  text += fmt::format(" {} {} {} {} {} {} {}", camera.orthographic, camera.yfov, camera.xmag, camera.ymag,
                      camera.aspect_ratio, camera.lens_radius, camera.focus_distance);
  for (int i = 0; i < 16; ++i) text += fmt::format(" {}", camera.camera_to_world.getValue()[i]);
  return xxh3_64(text);
}

}  // namespace

IrradianceStore::IrradianceStore(const JobSpec& spec, const Camera& camera, std::vector<ScenePart> parts)
    : parts_(std::move(parts)), view_(hash_of_view(spec, camera)) {
  content_.seed = spec.integrator.seed;
  if (spec.cache.file.empty()) return;
  file_ = spec.folder / spec.cache.file;
  const auto loaded = load(spec);
  if (!loaded) error_ = loaded.error();
  keeps_ = loaded.has_value();
}

Result<void> IrradianceStore::load(const JobSpec& spec) {
  content_.options = hash_of_options(spec);
  std::error_code unknown;
  if (!std::filesystem::exists(file_, unknown)) return {};
  const auto bytes = read_file(file_, kMaxFileBytes);
  if (!bytes) return tl::unexpected(bytes.error());
  auto read = parse_irradiance_file(*bytes, file_.string());
  if (!read) return tl::unexpected(read.error());
  if (read->options != content_.options) return {};
  content_ = std::move(*read);
  change_ = change_between(content_.parts, parts_);
  return {};
}

bool IrradianceStore::holds_view() const {
  return change_.empty() && std::find(content_.views.begin(), content_.views.end(), view_) != content_.views.end();
}

void IrradianceStore::write() {
  if (!change_.empty()) content_.views.clear();
  content_.views.push_back(view_);
  content_.parts = parts_;
  if (const auto written = write_file_atomically(file_, to_bytes(content_)); !written) error_ = written.error();
}

}  // namespace pf
