#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "worker/photon/irradiance_cache.h"
#include "worker/photon/irradiance_parts.h"
#include "worker/photon/irradiance_reach.h"

namespace pf {

/// An irradiance cache on disk: records, and what it takes to keep those that a change of the scene has not
/// touched.
struct IrradianceFile {
  std::uint64_t options = 0;         ///< hash of what decides a record's value besides the scene and its random numbers
  std::uint64_t seed = 0;            ///< of the gather rays' random numbers
  std::uint32_t next_id = 0;         ///< no record has this id or a larger one
  std::vector<std::uint64_t> views;  ///< for which an overture is done: hashes of camera, image and seed
  std::vector<ScenePart> parts;
  std::vector<IrradianceRecord> records;
  std::vector<RecordReach> reaches;  ///< by record
};

[[nodiscard]] std::string to_bytes(const IrradianceFile& file);
/// Never reads past `bytes` and allocates no more than a small multiple of their number. Errors:
/// kInvalidInput `origin: byte N: what; expected`.
[[nodiscard]] Result<IrradianceFile> parse_irradiance_file(std::string_view bytes, std::string_view origin);

}  // namespace pf
