#pragma once

#include <filesystem>
#include <vector>

#include "common/base/result.h"
#include "common/film/progressive.h"
#include "common/wire/blob_store.h"

namespace pf {

/// The radii of a round as one blob that every worker of the round reads: the chunks of pack_state, each after its
/// length (u32, little-endian).
[[nodiscard]] Result<BlobId> write_state_blob(const std::vector<ProgressivePixel>& state, BlobStore& store);
/// Errors: kInvalidInput for a file that is no state of `pixels` pixels.
[[nodiscard]] Result<std::vector<ProgressivePixel>> read_state_blob(const std::filesystem::path& file,
                                                                    std::size_t pixels);

}  // namespace pf
